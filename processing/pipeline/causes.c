#include "causes.h"

#include "base/config.h"
#include "base/robust.h"
#include "btf/btf.h"
#include "btf/btf_sigma.h"
#include "calibration/calibration.h"
#include "formats/nominal.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

/* there are no sentences about lasers if they see at least this share of the texels */
#define MIN_SEEN 0.3
/* minimum share of all pixels of the examined sweeps that must show a line */
#define MIN_LINES  0.02
#define MAX_SWEEPS 16 /* maximum number of sweeps that are examined */
#define MAX_FRAMES 8  /* maximum number of frames of a view that are examined */
/* a view is dark if its mean reflectance under the steepest light is below this; the blackest
 * paints reflect more */
#define DARK 0.0005
/* A view is also dark if two conditions hold: its mean reflectance is below DARK_SHARE of the
 * median over views, and the mean of its brightest frame is less than DARK_DN above the dark
 * level. */
#define DARK_SHARE 0.02
#define DARK_DN    5.0
/* a view is saturated if at least this share of its values are lower bounds */
#define MAX_SATURATED 0.5

struct texts {
    Config *rig_conf;
    gboolean imported; /* whether the session was imported; such a session has no rig file */
    Calibration *calibration;
    GPtrArray *views, *shots, *frames;
};

struct seen_view {
    const struct session_direction *view;
    /* mean: the mean green reflectance of the texels, under the light nearest to the normal
     * saturated: the share of the view's values that are lower bounds */
    double mean, saturated;
};

static gboolean texts_read(Session *session, const char *calibration, struct texts *ret,
                           GError **error) {
    g_autofree char *own = session_text(session, "calibration.conf", error);
    g_autofree char *rig = own ? session_text(session, "rig.conf", error) : NULL;
    g_autofree char *name = session_file(session, "session.db (rig.conf)");
    if (!rig ||
        !(ret->calibration = calibration_from_text(calibration ? calibration : own, name, error)))
        return FALSE;
    ret->rig_conf = config_parse(rig, name, error);
    if (!ret->rig_conf)
        return FALSE;
    gsize n;
    config_sections(ret->rig_conf, &n);
    ret->imported = n == 0;
    return (ret->views = session_views(session, error)) &&
           (ret->shots = session_shots(session, error)) &&
           (ret->frames = session_frames(session, error));
}

static void texts_clear(struct texts *texts) {
    g_clear_pointer(&texts->rig_conf, config_free);
    g_clear_pointer(&texts->calibration, calibration_free);
    g_clear_pointer(&texts->views, g_ptr_array_unref);
    g_clear_pointer(&texts->shots, g_ptr_array_unref);
    g_clear_pointer(&texts->frames, g_ptr_array_unref);
}

static const struct session_shot *shot_of(const struct texts *texts,
                                          const struct session_frame *frame) {
    return frame->shot >= 1 && frame->shot <= (gint64)texts->shots->len
               ? texts->shots->pdata[frame->shot - 1]
               : NULL;
}

/* Examines at most MAX_SWEEPS sweeps. ret_lines receives the share of their pixels that show a
 * line, and ret_sweeps the number of sweeps that could be read. */
static void look_at_sweeps(Session *session, const struct texts *texts, double *ret_lines,
                           int *ret_sweeps) {
    g_autoptr(GPtrArray) sweeps = g_ptr_array_new();
    double lines = 0, pixels = 0;
    for (guint i = 0; i < texts->frames->len; i++) {
        const struct session_shot *shot = shot_of(texts, texts->frames->pdata[i]);
        if (shot && shot->kind == SHOT_SWEEP)
            g_ptr_array_add(sweeps, texts->frames->pdata[i]);
    }
    const guint step = 1 + sweeps->len / (MAX_SWEEPS + 1);
    *ret_sweeps = 0;
    for (guint i = 0; i < sweeps->len; i += step) {
        const struct session_frame *frame = sweeps->pdata[i];
        g_autofree char *path = session_file(session, frame->path);
        g_autoptr(ExrPart) part = exr_read_part(path, "sweep", NULL);
        const float *peak = part ? exr_part_plane(part, "peak") : NULL;
        const gsize n = peak ? (gsize)part->width * (gsize)part->height : 0;
        for (gsize k = 0; k < n; k++)
            lines += peak[k] >= 0;
        pixels += (double)n;
        *ret_sweeps += peak != NULL;
    }
    *ret_lines = pixels > 0 ? lines / pixels : 0;
}

static void explain_mdf(Session *session, const struct texts *texts, double mdf_coverage,
                        GPtrArray *ret) {
    struct session_grid grid;
    double lines;
    int sweeps;
    if (mdf_coverage >= MIN_SEEN || !session_grid(session, &grid, NULL))
        return;
    look_at_sweeps(session, texts, &lines, &sweeps);
    g_autofree char *seen =
        mdf_coverage > 0
            ? g_strdup_printf("only %.2g %% of the texels are seen by a laser", 100 * mdf_coverage)
            : g_strdup("no texel is seen by a laser");
    if (sweeps == 0)
        g_ptr_array_add(ret,
                        g_strdup_printf("%s, and no file of a sweep can be read; “mesorig verify” "
                                        "names damaged files",
                                        seen));
    else if (lines < MIN_LINES)
        g_ptr_array_add(
            ret, g_strdup_printf("%s: %.2g %% of the pixels of %d sweeps show a line; %s", seen,
                                 100 * lines, sweeps,
                                 texts->imported
                                     ? "import again with a lower --threshold, or take the sweeps "
                                       "with a longer exposure"
                                     : "set a longer laser_exposure_us or a lower "
                                       "laser_threshold_dn in [capture] of the session file"));
    else
        g_ptr_array_add(
            ret,
            g_strdup_printf(
                "%s: %.2g %% of the pixels show a line, but not between the reference plane at %g "
                "mm and depth_mm = %g below it; correct %s, or calibrate the lasers",
                seen, 100 * lines, grid.reference_mm, grid.depth_mm,
                texts->imported ? "--reference and --depth of mesorig import poses"
                                : "reference_mm and depth_mm in [sample] of the session file"));
}

/* Sets mean and saturated from a view's file. Returns FALSE if the file is missing or cannot be
 * used. */
static gboolean see_view(const char *path, struct seen_view *ret, GError **error) {
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
        return FALSE;
    g_autoptr(ExrFile) headers = exr_read_headers(path, error);
    const struct exr_part *steepest = NULL;
    struct btf_flag_counts counts = {0};
    float theta_deg, phi_deg, least_deg = 360;
    for (guint i = 0; headers && i < headers->parts->len; i++) {
        const struct exr_part *part = headers->parts->pdata[i];
        btf_count_flags(part, &counts);
        if (!btf_direction(part, "light", &theta_deg, &phi_deg) || theta_deg >= least_deg)
            continue;
        least_deg = theta_deg;
        steepest = part;
    }
    g_autoptr(ExrPart) part = steepest ? exr_read_part(path, steepest->name, error) : NULL;
    const float *green = part ? exr_part_plane(part, "G") : NULL;
    if (!green)
        return FALSE;
    const gsize n = (gsize)part->width * (gsize)part->height;
    ret->mean = 0;
    for (gsize k = 0; k < n; k++)
        ret->mean += (double)green[k] / (double)n;
    ret->saturated = counts.texels > 0 ? (double)counts.bounds / (double)counts.texels : 0;
    return TRUE;
}

/* Returns the mean value of the brightest of at most MAX_FRAMES frames of a view, in DN above the
 * dark level, at the longest exposure of the frame. ret_us receives this exposure in µs. Returns −∞
 * if no frame can be read. */
static double brightest_dn(Session *session, const struct texts *texts,
                           const struct session_direction *view, double *ret_us) {
    double most = -HUGE_VAL;
    int looked = 0;
    *ret_us = 0;
    for (guint i = 0; i < texts->frames->len && looked < MAX_FRAMES; i++) {
        const struct session_frame *frame = texts->frames->pdata[i];
        const struct session_shot *shot = shot_of(texts, frame);
        if (!shot || shot->kind != SHOT_LAMP || frame->camera != view->device ||
            shot->turntable_deg != view->turntable_deg)
            continue;
        g_autofree char *path = session_file(session, frame->path);
        g_autoptr(ExrPart) part = exr_read_part(path, "radiance", NULL);
        struct btf_exposures exposures;
        const float *plane = part && part->n_channels > 0 ? part->planes[0] : NULL;
        if (!plane || !btf_exposures_read(part, path, &exposures, NULL) || exposures.n == 0)
            continue;
        const gsize n = (gsize)part->width * (gsize)part->height;
        double sum = 0;
        gsize finite = 0;
        for (gsize k = 0; k < n; k++)
            if (isfinite(plane[k])) {
                sum += (double)plane[k];
                finite++;
            }
        const double ms = exposures.ms[exposures.n - 1];
        if (finite > 0 && sum / (double)finite * ms > most) {
            most = sum / (double)finite * ms;
            *ret_us = 1000 * ms;
        }
        looked++;
    }
    return most;
}

static char *name_views(const struct texts *texts, int n, int of, const struct seen_view *first) {
    return g_strdup_printf(
        "%d of %d views (the first is view %d, %.0f° from the normal, camera %s) %s", n, of,
        first->view->index, first->view->theta_deg,
        texts->calibration->rig.cameras[first->view->device].name, n == 1 ? "is" : "are");
}

/* Explains the views that are dark. A view is dark if its mean is below DARK. It is also dark if
 * its mean is below DARK_SHARE of the median of all views, and brightest_dn() below DARK_DN. */
static void explain_dark(Session *session, const struct texts *texts, const GArray *seen,
                         GPtrArray *ret) {
    g_autofree double *means = g_new(double, seen->len);
    const struct seen_view *first = NULL;
    double dn = 0, us = 0;
    int n = 0;
    for (guint i = 0; i < seen->len; i++)
        means[i] = g_array_index(seen, struct seen_view, i).mean;
    const double median = robust_median(means, (int)seen->len);
    for (guint i = 0; i < seen->len; i++) {
        const struct seen_view *one = &g_array_index(seen, struct seen_view, i);
        double its_us;
        if (one->mean >= DARK && one->mean >= DARK_SHARE * median)
            continue;
        const double its_dn = brightest_dn(session, texts, one->view, &its_us);
        if (one->mean >= DARK && its_dn >= DARK_DN)
            continue;
        if (n++ > 0)
            continue;
        first = one;
        dn = its_dn;
        us = its_us;
    }
    if (!first)
        return;
    g_autofree char *which = name_views(texts, n, (int)seen->len, first);
    const struct rig_camera *camera = &texts->calibration->rig.cameras[first->view->device];
    if (!isfinite(dn))
        g_ptr_array_add(
            ret, g_strdup_printf("%s dark, and no frame of the first can be read; “mesorig "
                                 "verify” names damaged files; if there are none, look "
                                 "whether the lens of camera %s is open and the lamps are on",
                                 which, camera->name));
    else if (dn < DARK_DN)
        g_ptr_array_add(
            ret, g_strdup_printf("%s dark: a picture of the first is %.2g DN above dark at %g µs; "
                                 "%s, "
                                 "and look whether the lens of camera %s is open and the lamps "
                                 "are on",
                                 which, dn, us,
                                 texts->imported ? "take the pictures with longer exposures"
                                                 : "set longer exposures_us in [capture] of the "
                                                   "session file",
                                 camera->name));
    else
        g_ptr_array_add(
            ret, g_strdup_printf(
                     "%s dark: the first has %.2g of the brightness of a white surface, although a "
                     "picture of it is %.3g DN above dark; response of [camera %s] = %g or the "
                     "intensity of the lamps is too large: measure a white tile (mesorig calibrate "
                     "radiometry), or correct them in %s",
                     which, first->mean, dn, camera->name, camera->response,
                     texts->imported ? "the file of nominal values" : "the rig file"));
}

static void explain_saturated(const struct texts *texts, const GArray *seen, GPtrArray *ret) {
    const struct seen_view *first = NULL;
    int n = 0;
    for (guint i = 0; i < seen->len; i++) {
        const struct seen_view *one = &g_array_index(seen, struct seen_view, i);
        if (one->saturated >= MAX_SATURATED)
            first = n++ == 0 ? one : first;
    }
    if (!first)
        return;
    g_autofree char *which = name_views(texts, n, (int)seen->len, first);
    g_ptr_array_add(
        ret,
        g_strdup_printf("%s saturated: %.0f %% of the values of the first are lower bounds; %s",
                        which, 100 * first->saturated,
                        texts->imported
                            ? "take the pictures with shorter exposures, or correct bits in the "
                              "table"
                            : "add a shorter exposure to exposures_us in [capture] of the "
                              "session file"));
}

/* Explains cameras that are not calibrated and whose response was not given. */
static void explain_response(const struct texts *texts, GPtrArray *ret) {
    const struct calibration *calibration = texts->calibration;
    const char *first = NULL;
    double value = 0;
    int n = 0;
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct rig_camera *camera = &calibration->rig.cameras[c];
        const struct config_section *section = config_find(texts->rig_conf, "camera", camera->name);
        const gboolean given = texts->imported
                                   ? camera->response != NOMINAL_RESPONSE
                                   : !section || config_value(section, "response", NULL);
        if (calibration->camera_radiometry[c].known || given)
            continue;
        if (n++ == 0) {
            first = camera->name;
            value = camera->response;
        }
    }
    if (first)
        g_ptr_array_add(
            ret, g_strdup_printf(
                     "all values may be wrong by a common factor: response of [camera %s] = %g "
                     "is the default (%d of %d cameras); measure a white tile (mesorig "
                     "calibrate radiometry), or set response in %s",
                     first, value, n, calibration->rig.n_cameras,
                     texts->imported ? "the file of nominal values" : "the rig file"));
}

gboolean causes_find(const char *directory, const char *calibration, gboolean has_btf,
                     double mdf_coverage, GPtrArray *ret, GError **error) {
    struct texts texts = {0};
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(struct seen_view));
    if (!session || !texts_read(session, calibration, &texts, error)) {
        texts_clear(&texts);
        return FALSE;
    }
    session_suspicions(session, ret);
    explain_mdf(session, &texts, mdf_coverage, ret);
    for (guint i = 0; has_btf && i < texts.views->len; i++) {
        struct seen_view one = {.view = texts.views->pdata[i]};
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", one.view->index);
        g_autofree char *path = session_file(session, relative);
        if (one.view->device < texts.calibration->rig.n_cameras && see_view(path, &one, NULL))
            g_array_append_val(seen, one);
    }
    if (seen->len > 0) {
        explain_dark(session, &texts, seen, ret);
        explain_saturated(&texts, seen, ret);
        explain_response(&texts, ret);
    }
    texts_clear(&texts);
    return TRUE;
}
