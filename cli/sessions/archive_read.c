/* Gathers the data of a session. */
#include "archive.h"

#include "base/config.h"
#include "base/robust.h"
#include "btf/btf.h"
#include "btf/btf_sigma.h"
#include "mdf/mdf_views.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

/* Views whose polar angles differ by less than this form one ring. */
#define SAME_RING_DEG 1.0
/* Limits of shares and ratios. A check gives a warning above …_WARN, and fails above …_FAIL.
 * MEASURED_WARN is different: the warning is given below it. */
#define RETAKES_WARN     0.01
#define LATE_WARN        1.25
#define HOLES_WARN       0.01
#define HOLES_FAIL       0.10
#define BOUNDS_WARN      0.001
#define BOUNDS_FAIL      0.05
#define MEASURED_WARN    0.95
#define CALIBRATION_DAYS 30 /* default of calibration_days in [rig] */

static void check_free(gpointer data) {
    struct archive_check *check = data;
    g_free(check->name);
    g_free(check->said);
    g_free(check);
}

static void device_free(gpointer data) {
    struct archive_device *device = data;
    g_free(device->section);
    g_free(device->driver);
    g_free(device->address);
    g_free(device);
}

static void picture_free(gpointer data) {
    struct archive_picture *picture = data;
    g_free(picture->caption);
    g_bytes_unref(picture->png);
    g_free(picture);
}

void archive_free(struct archive *archive) {
    if (!archive)
        return;
    char *const texts[] = {archive->path,     archive->name,   archive->program,
                           archive->created,  archive->sample, archive->operator_name,
                           archive->notes,    archive->state,  archive->license,
                           archive->imported, archive->chosen};
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
        g_free(texts[i]);
    calibration_free(archive->calibration);
    archive_calibration_clear(&archive->calibrated);
    GPtrArray *const arrays[] = {archive->devices, archive->checks, archive->pictures,
                                 archive->products, archive->events};
    for (gsize i = 0; i < G_N_ELEMENTS(arrays); i++)
        if (arrays[i])
            g_ptr_array_unref(arrays[i]);
    g_array_unref(archive->rings);
    g_free(archive);
}

const char *archive_verdict_name(enum archive_verdict verdict) {
    static const char *const names[] = {"pass", "warning", "failure"};
    return names[verdict];
}

void archive_add_check(struct archive *archive, enum archive_verdict verdict, const char *name,
                       const char *format, ...) {
    struct archive_check *check = g_new0(struct archive_check, 1);
    va_list arguments;
    va_start(arguments, format);
    check->verdict = verdict;
    check->name = g_strdup(name);
    check->said = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_ptr_array_add(archive->checks, check);
}

enum archive_verdict archive_verdict(const struct archive *archive) {
    enum archive_verdict worst = ARCHIVE_PASS;
    for (guint i = 0; i < archive->checks->len; i++)
        worst = MAX(worst, ((struct archive_check *)archive->checks->pdata[i])->verdict);
    return worst;
}

static enum archive_verdict verdict_of(double value, double warn, double fail) {
    return value > fail ? ARCHIVE_FAILURE : value > warn ? ARCHIVE_WARNING : ARCHIVE_PASS;
}

static double number(Session *session, const char *key) {
    g_autofree char *text = session_value(session, key);
    return text ? g_ascii_strtod(text, NULL) : NAN;
}

static int length_of(GPtrArray *array) {
    const int n = array ? (int)array->len : 0;
    g_clear_pointer(&array, g_ptr_array_unref);
    return n;
}

/* Returns the value of a key of [session] as the operator wrote it, or "" if there is none. */
static char *described(const Config *conf, const char *key) {
    const struct config_section *section = conf ? config_find(conf, "session", NULL) : NULL;
    const char *value = section ? config_value(section, key, NULL) : NULL;
    return g_strdup(value ? value : "");
}

/* Reads the calibration with which the products were made. It may differ from that of the capture.
 * Adds checks of the age of each part, of the parts that are not calibrated, and of products that
 * may have been made with another calibration. A session that was resampled, or imported as a
 * finished BTF, has no calibration; nothing is then read or added. */
static gboolean read_calibration(struct archive *archive, Session *session, const Config *rig,
                                 GError **error) {
    g_autofree char *own = session_text(session, "calibration.conf", error);
    g_autoptr(Config) none = own ? config_parse(own, "calibration.conf", NULL) : NULL;
    gsize n_sections = 1;
    if (!own)
        return FALSE;
    if (none)
        config_sections(none, &n_sections);
    if (n_sections == 0) /* imported as a finished BTF, or resampled */
        return TRUE;
    archive->calibration = archive_calibration(session, &archive->calibrated, error);
    if (!archive->calibration)
        return FALSE;
    if (archive->calibrated.mixed)
        archive_add_check(
            archive, ARCHIVE_FAILURE, "calibration",
            "some products may have been made with another calibration than this page "
            "says, because their processing was not finished: mesorig process %s",
            archive->path);
    const struct config_section *section = rig ? config_find(rig, "rig", NULL) : NULL;
    const char *days = section ? config_value(section, "calibration_days", NULL) : NULL;
    const double most = days ? g_ascii_strtod(days, NULL) : CALIBRATION_DAYS;
    g_autoptr(GDateTime) created = g_date_time_new_from_iso8601(archive->created, NULL);
    g_autoptr(GString) nominal = g_string_new(NULL);
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        const struct calibration_part *part = &archive->calibration->parts[i];
        const char *name = calibration_part_name((enum calibration_kind)i);
        g_autoptr(GDateTime) date =
            part->done ? g_date_time_new_from_iso8601(part->date, NULL) : NULL;
        if (!part->done) {
            if (i != CALIBRATION_LASER || archive->calibration->rig.n_lasers > 0)
                g_string_append_printf(nominal, "%s%s", nominal->len ? ", " : "", name);
            continue;
        }
        const double age =
            date && created ? (double)g_date_time_difference(created, date) / G_TIME_SPAN_DAY : 0;
        archive_add_check(archive, age > most ? ARCHIVE_WARNING : ARCHIVE_PASS, "calibration",
                          "%s: residual %.3g %s RMS from %d pictures, %.0f days old when the "
                          "session was planned (%.0f are allowed)",
                          name, part->residual_rms, part->residual_unit, part->pictures,
                          MAX(age, 0), most);
    }
    if (nominal->len > 0)
        archive_add_check(archive, ARCHIVE_WARNING, "calibration",
                          "not calibrated, nominal values were used: %s; mesorig calibrate finds "
                          "them, mesorig process -c FILE uses them",
                          nominal->str);
    return TRUE;
}

static gboolean read_texts(struct archive *archive, Session *session, GError **error) {
    g_autofree char *conf_text = session_text(session, "session.conf", error);
    g_autofree char *rig_text = conf_text ? session_text(session, "rig.conf", error) : NULL;
    if (!rig_text)
        return FALSE;
    /* An imported session need not have a session file and a rig file. conf or rig is then NULL. */
    g_autoptr(Config) conf = config_parse(conf_text, "session.conf", NULL);
    g_autoptr(Config) rig = config_parse(rig_text, "rig.conf", NULL);
    archive->sample = described(conf, "sample");
    archive->operator_name = described(conf, "operator");
    archive->notes = described(conf, "notes");
    archive->license = described(conf, "license");
    gsize n = 0;
    const struct config_section *sections = rig ? config_sections(rig, &n) : NULL;
    for (gsize i = 0; i < n; i++) {
        static const char *const addresses[] = {"device", "serial", "address", "host", "line"};
        const char *driver = config_value(&sections[i], "driver", NULL), *address = NULL;
        struct archive_device *device = g_new0(struct archive_device, 1);
        for (gsize k = 0; k < G_N_ELEMENTS(addresses) && !address; k++)
            address = config_value(&sections[i], addresses[k], NULL);
        device->section = g_strdup(sections[i].group);
        device->driver = g_strdup(driver ? driver : "");
        device->address = g_strdup(address ? address : "");
        g_ptr_array_add(archive->devices, device);
    }
    return read_calibration(archive, session, rig, error);
}

/* Returns whether an event is a pause that the user requested. Such a pause is not a fault of
 * the capture. */
static gboolean asked_to_pause(const struct session_event *event) {
    return g_str_equal(event->source, "capture") &&
           g_str_equal(event->message, "paused by the user");
}

static void check_capture(struct archive *archive) {
    const int shots = archive->planned + archive->done + archive->skipped + archive->unneeded;
    if (archive->planned > 0)
        archive_add_check(archive, ARCHIVE_FAILURE, "shots",
                          "%d of %d shots are still to be taken: mesorig resume %s",
                          archive->planned, shots, archive->path);
    else
        archive_add_check(archive, archive->skipped ? ARCHIVE_WARNING : ARCHIVE_PASS, "shots",
                          "%d of %d done, %d left out by the plan%s", archive->done, shots,
                          archive->skipped, archive->unneeded > 0 ? ", the others not needed" : "");
    if (archive->frames > 0 && !archive->imported)
        archive_add_check(archive,
                          verdict_of((double)archive->retakes / archive->frames, RETAKES_WARN, 1),
                          "retakes", "%d frames were refused and taken again, %d were kept",
                          archive->retakes, archive->frames);
    if (archive->planned == 0 && archive->clock_s > 0 && archive->predicted_s > 0)
        archive_add_check(archive,
                          verdict_of(archive->clock_s / archive->predicted_s, LATE_WARN, INFINITY),
                          "time", "the capture took %.0f s, and the plan said %.0f s",
                          archive->clock_s, archive->predicted_s);
    int errors = 0, warnings = 0;
    for (guint i = 0; i < archive->events->len; i++) {
        const struct session_event *event = archive->events->pdata[i];
        errors += g_str_equal(event->level, "error");
        warnings += g_str_equal(event->level, "warning") && !asked_to_pause(event);
    }
    archive_add_check(archive, errors + warnings ? ARCHIVE_WARNING : ARCHIVE_PASS, "events",
                      "%d errors and %d warnings during the capture", errors, warnings);
}

static gboolean read_rows(struct archive *archive, Session *session, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) frames = shots ? session_frames(session, error) : NULL;
    archive->products = frames ? session_list_products(session, error) : NULL;
    archive->events = archive->products ? session_events(session, error) : NULL;
    if (!archive->events || !session_grid(session, &archive->grid, error) ||
        !session_origin(session, &archive->program, &archive->created, error))
        return FALSE;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        archive->planned += shot->state == SHOT_PLANNED;
        archive->done += shot->state == SHOT_DONE;
        const gboolean unneeded = shot->note && g_str_has_prefix(shot->note, SESSION_LEFT_OUT);
        archive->unneeded += shot->state == SHOT_SKIPPED && unneeded;
        archive->skipped += shot->state == SHOT_SKIPPED && !unneeded;
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        archive->frames++;
        archive->retakes += frame->retakes;
        archive->frame_bytes += frame->bytes;
    }
    for (guint i = 0; i < archive->products->len; i++)
        archive->product_bytes += ((struct session_product *)archive->products->pdata[i])->bytes;
    archive->views = length_of(session_views(session, NULL));
    archive->lights = length_of(session_lights(session, NULL));
    archive->lasers = length_of(session_lasers(session, NULL));
    g_autofree char *state = session_value(session, "state");
    /* No process is capturing the session now. If its state is "running", the capture was
     * interrupted. */
    archive->state = g_strdup(archive->planned == 0                     ? "done"
                              : !state || g_str_equal(state, "running") ? "unfinished"
                                                                        : state);
    archive->imported = session_value(session, "imported");
    archive->chosen = session_value(session, "chosen");
    archive->predicted_s = number(session, "predicted_s");
    archive->predicted_bytes = number(session, "predicted_bytes");
    archive->clock_s = number(session, "clock_s");
    archive->processing_s = number(session, "processing_s");
    return TRUE;
}

static struct archive_ring *ring_of(struct archive *archive, double theta_deg) {
    for (guint i = 0; i < archive->rings->len; i++) {
        struct archive_ring *ring = &g_array_index(archive->rings, struct archive_ring, i);
        if (fabs(ring->theta_deg - theta_deg) < SAME_RING_DEG)
            return ring;
    }
    const struct archive_ring ring = {.theta_deg = theta_deg,
                                      .sigma = NAN,
                                      .holes = NAN,
                                      .bounds = NAN,
                                      .shorter = NAN,
                                      .predicted = NAN,
                                      .measured = NAN,
                                      .supplied = NAN};
    g_array_append_val(archive->rings, ring);
    return &g_array_index(archive->rings, struct archive_ring, archive->rings->len - 1);
}

static int by_theta(gconstpointer a, gconstpointer b) {
    const double x = ((const struct archive_ring *)a)->theta_deg;
    const double y = ((const struct archive_ring *)b)->theta_deg;
    return (x > y) - (x < y);
}

/* Reads the BTF's flags and error bars into the rings. Adds a failed check if views cannot be read
 * or are missing. Adds checks of the shares of holes and lower bounds. */
static void read_btf(struct archive *archive, const GPtrArray *views) {
    struct btf_flag_counts all = {0};
    int unreadable = 0, made = 0;
    for (guint r = 0; r < archive->rings->len; r++) {
        struct archive_ring *ring = &g_array_index(archive->rings, struct archive_ring, r);
        struct btf_flag_counts counts = {0};
        g_autoptr(GArray) sigmas = g_array_new(FALSE, FALSE, sizeof(double));
        for (guint v = 0; v < views->len; v++) {
            const struct session_direction *view = views->pdata[v];
            g_autofree char *path =
                g_strdup_printf("%s/products/btf/view_%04d.exr", archive->path, view->index);
            if (fabs(view->theta_deg - ring->theta_deg) >= SAME_RING_DEG ||
                !g_file_test(path, G_FILE_TEST_EXISTS))
                continue;
            g_autoptr(ExrFile) file = exr_read_headers(path, NULL);
            unreadable += !file;
            made += file != NULL;
            for (guint k = 0; file && k < file->parts->len; k++) {
                struct btf_sigma sigma;
                btf_count_flags(file->parts->pdata[k], &counts);
                ring->pictures++;
                if (btf_sigma_read(file->parts->pdata[k], &sigma))
                    g_array_append_val(sigmas, sigma.relative);
            }
        }
        if (counts.texels == 0)
            continue;
        const double texels = (double)counts.texels;
        ring->holes = (double)counts.holes / texels;
        ring->bounds = (double)counts.bounds / texels;
        ring->shorter = (double)counts.shorter / texels;
        ring->predicted = (double)counts.predicted / texels;
        g_array_sort(sigmas, robust_by_value);
        if (sigmas->len > 0)
            ring->sigma = g_array_index(sigmas, double, sigmas->len / 2);
        all.texels += counts.texels;
        all.holes += counts.holes;
        all.bounds += counts.bounds;
    }
    if (unreadable > 0)
        archive_add_check(archive, ARCHIVE_FAILURE, "BTF",
                          "%d views cannot be read: mesorig verify %s", unreadable, archive->path);
    if (made < archive->views && archive->lights > 0)
        archive_add_check(archive, ARCHIVE_FAILURE, "BTF",
                          "%d of %d views are there: mesorig process %s", made, archive->views,
                          archive->path);
    if (all.texels == 0)
        return;
    const double holes = (double)all.holes / (double)all.texels;
    const double bounds = (double)all.bounds / (double)all.texels;
    archive_add_check(archive, verdict_of(holes, HOLES_WARN, HOLES_FAIL), "coverage",
                      "%.3g %% of the BTF's values are holes: outside of the picture, or hidden",
                      100 * holes);
    archive_add_check(archive, verdict_of(bounds, BOUNDS_WARN, BOUNDS_FAIL), "saturation",
                      "%.3g %% of the BTF's values are lower bounds: saturated in the shortest "
                      "exposure",
                      100 * bounds);
}

/* Adds two shares of the MDF's texels to each ring: those that the view measured, and those that
 * other views supply. Adds a check of their sum. If a session of sweeps has no MDF, adds a failed
 * check. Returns FALSE with an error if the MDF cannot be read, or if the work is cancelled. */
static gboolean read_mdf(struct archive *archive, const struct work *work, GError **error) {
    g_autofree char *path = g_build_filename(archive->path, "products", "mdf.exr", NULL);
    if (!g_file_test(path, G_FILE_TEST_EXISTS)) {
        if (archive->lasers > 0)
            archive_add_check(archive, ARCHIVE_FAILURE, "MDF",
                              "there is no products/mdf.exr: mesorig process %s", archive->path);
        return TRUE;
    }
    g_autoptr(ExrFile) headers = exr_read_headers(path, error);
    const gint64 begun_us = g_get_monotonic_time();
    double measured_sum = 0;
    for (guint i = 0; headers && i < headers->parts->len; i++) {
        const struct exr_part *header = headers->parts->pdata[i];
        g_autoptr(ExrPart) part = exr_read_part(path, header->name, error);
        const float *source = part ? exr_part_plane(part, "P") : NULL;
        double theta_deg;
        if (!part || !exr_get_double(part, "view.theta_deg", &theta_deg, error))
            return FALSE;
        struct archive_ring *ring = ring_of(archive, theta_deg);
        const gsize n = (gsize)part->width * (gsize)part->height;
        double measured = 0, supplied = 0;
        for (gsize k = 0; source && k < n; k++) {
            measured += source[k] == MDF_MEASURED || source[k] == MDF_OTHER;
            supplied += source[k] == MDF_PREDICTED;
        }
        const double share = 1.0 / ((double)n * MAX(ring->views, 1));
        ring->measured = (isnan(ring->measured) ? 0 : ring->measured) + measured * share;
        ring->supplied = (isnan(ring->supplied) ? 0 : ring->supplied) + supplied * share;
        measured_sum += (measured + supplied) / (double)n / headers->parts->len;
        if (!work_tell(work, "read", (int)i + 1, (int)headers->parts->len, begun_us, error))
            return FALSE;
    }
    if (headers)
        archive_add_check(archive, measured_sum < MEASURED_WARN ? ARCHIVE_WARNING : ARCHIVE_PASS,
                          "MDF", "the surface is known at %.2f %% of the texels of all views",
                          100 * measured_sum);
    return headers != NULL;
}

static gboolean check_files(struct archive *archive, Session *session, const struct work *work,
                            GError **error) {
    for (int i = 0; i < 2; i++) {
        int examined = 0;
        g_autoptr(GPtrArray) damages = session_find_damage(
            session, i ? SESSION_PRODUCTS_MADE : SESSION_FRAMES, "", work, &examined, error);
        if (!damages)
            return FALSE;
        archive_add_check(archive, damages->len ? ARCHIVE_FAILURE : ARCHIVE_PASS, "files",
                          "%d %s have the SHA-256 that the session lists, %u do not%s%s",
                          examined - (int)damages->len, i ? "products" : "frames", damages->len,
                          damages->len ? ": mesorig verify " : "",
                          damages->len ? archive->path : "");
    }
    return TRUE;
}

struct archive *archive_read(const char *path, gboolean verify, const struct work *work,
                             GError **error) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (!session)
        return NULL;
    g_autoptr(Archive) archive = g_new0(struct archive, 1);
    archive->path = g_strdup(session_path(session));
    archive->name = g_strdup(session_name(session));
    archive->devices = g_ptr_array_new_with_free_func(device_free);
    archive->checks = g_ptr_array_new_with_free_func(check_free);
    archive->pictures = g_ptr_array_new_with_free_func(picture_free);
    archive->rings = g_array_new(FALSE, FALSE, sizeof(struct archive_ring));
    g_autoptr(GPtrArray) views = session_views(session, error);
    if (!views || !read_rows(archive, session, error) || !read_texts(archive, session, error))
        return NULL;
    for (guint i = 0; i < views->len; i++)
        ring_of(archive, ((struct session_direction *)views->pdata[i])->theta_deg)->views++;
    g_array_sort(archive->rings, by_theta);
    check_capture(archive);
    read_btf(archive, views);
    if (!read_mdf(archive, work, error) || (verify && !check_files(archive, session, work, error)))
        return NULL;
    return g_steal_pointer(&archive);
}
