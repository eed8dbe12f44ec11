#include "coverage_view.h"

#include <math.h>

#include "frames/rectify.h"
#include "mdf/mdf.h"

#define RAD(deg) ((deg) * (G_PI / 180))
/* sine of the angle between ray and sheet, below which the depth is noise, as in mdf.c */
#define MIN_SINE 0.03
/* minimum number of peaks in a live phase (one that sees the laser) of the colour filter, relative
 * to the best phase, as in mdf.c */
#define LIVE_SHARE 0.25
/* Distances of two sweeps agree if they differ by at most TEXEL_SHARE of a texel, or by at most
 * FRAME_SHARE of the depth that corresponds to one frame of a sweep. */
#define TEXEL_SHARE 0.5
#define FRAME_SHARE 0.3
/* In texels. A point that is higher above the reference plane than this, or deeper below the
 * deepest structure, does not belong to the sample. */
#define OUTSIDE_SHARE 2.0
#define AGREE         2 /* minimum number of agreeing sweeps that make a distance known */

struct sample { /* a texel that is examined */
    /* The pixel above and to the left of the texel's centre. Together with those of the next column
     * and row, it covers all four phases of the colour filter. */
    int x, y;
    struct vec3 ray[4]; /* of the pixel (x + (k & 1), y + (k >> 1)) */
    float onset_mm[4];  /* distance along ray[k] from the camera to the reference plane, mm */
};

struct seen {
    /* distances from the brightest and from the second pulse; −1 if there is no pulse */
    float mm[2];
};

struct CoverageView {
    struct rig *rig; /* the rig as the sample sees it (rig_at()) */
    int camera;
    struct session_grid grid;
    struct vec3 centre_mm;
    double texel_mm, agreement_mm;
    GArray *samples; /* of struct sample */
    /* of guint64: for each texel that is not known, the set of sweeps that saw something there */
    GArray *open;
    /* for each sweep, an array of what it saw at each sample; NULL if the sweep was not added */
    struct seen *seen[COVERAGE_MAX_SWEEPS];
    double frame_mm[COVERAGE_MAX_SWEEPS];
};

static gboolean project(const CoverageView *view, double turntable_rad, int texel,
                        struct sample *ret) {
    const struct rig_camera *camera = &view->rig->cameras[view->camera];
    const int row = texel / view->grid.width, column = texel % view->grid.width;
    const struct vec3 p =
        rig_turn(rectify_point_mm(&view->grid, column + 0.5, row + 0.5), turntable_rad);
    double x, y;
    if (!rig_project(camera, p, &x, &y) || !(x >= 0) || !(y >= 0) || !(x < camera->width - 1) ||
        !(y < camera->height - 1))
        return FALSE;
    *ret = (struct sample){.x = (int)x, .y = (int)y};
    for (int k = 0; k < 4; k++) {
        ret->ray[k] = rig_pixel_ray(camera, ret->x + (k & 1), ret->y + (k >> 1));
        ret->onset_mm[k] = (float)((view->grid.reference_mm - view->centre_mm.z) / ret->ray[k].z);
    }
    return TRUE;
}

CoverageView *coverage_view_new(const struct rig *rig, int camera, double turntable_deg,
                                const struct session_grid *grid) {
    CoverageView *view = g_new0(CoverageView, 1);
    view->rig = g_new(struct rig, 1);
    rig_at(rig, RAD(turntable_deg), view->rig);
    view->camera = camera;
    view->grid = *grid;
    view->centre_mm = rig_camera_centre_mm(&view->rig->cameras[camera]);
    view->texel_mm = grid->width_mm / grid->width;
    const double slant = view->centre_mm.z / vec3_length(view->centre_mm);
    view->agreement_mm = TEXEL_SHARE * view->texel_mm / MAX(slant, 0.1);
    view->samples = g_array_new(FALSE, FALSE, sizeof(struct sample));
    view->open = g_array_new(FALSE, FALSE, sizeof(guint64));
    /* Examines only every step-th row and column of the grid. */
    const double all = (double)grid->width * grid->height;
    const int step = MAX(1, (int)ceil(sqrt(all / COVERAGE_MAX_TEXELS)));
    for (int row = step / 2; row < grid->height; row += step)
        for (int column = step / 2; column < grid->width; column += step) {
            struct sample sample;
            if (project(view, RAD(turntable_deg), row * grid->width + column, &sample))
                g_array_append_val(view->samples, sample);
        }
    return view;
}

void coverage_view_free(CoverageView *view) {
    if (!view)
        return;
    for (int i = 0; i < COVERAGE_MAX_SWEEPS; i++)
        g_free(view->seen[i]);
    g_free(view->rig);
    g_array_unref(view->samples);
    g_array_unref(view->open);
    g_free(view);
}

/* Finds the phases of the 2 × 2 colour filter that see the laser. */
static void phases(const struct exr_part *part, const float *peak, gboolean ret_live[4]) {
    int seen[4] = {0}, most = 0;
    for (int y = 0; y < part->height; y++)
        for (int x = 0; x < part->width; x++)
            seen[2 * (y & 1) + (x & 1)] += peak[(gsize)y * (gsize)part->width + (gsize)x] >= 0;
    for (int k = 0; k < 4; k++)
        most = MAX(most, seen[k]);
    for (int k = 0; k < 4; k++)
        ret_live[k] = seen[k] > LIVE_SHARE * most;
}

/* Returns the distance along a ray from the reference plane to the sheet at a peak's time. Returns
 * −1 if there is no peak, or if the sheet is at a grazing angle. Returns −1 also if the point is
 * outside of the sample's volume by more than OUTSIDE_SHARE. */
static float distance(const CoverageView *view, const struct laser_sheets *sheets,
                      const struct sample *sample, int k, float peak) {
    if (!(peak >= 0) || !isfinite(peak))
        return -1;
    const struct vec3 ray = sample->ray[k];
    if (!(ray.z < 0))
        return -1;
    const double range = laser_lines_range_mm(sheets, (double)peak, view->centre_mm, ray, MIN_SINE);
    const double height = view->centre_mm.z + range * ray.z - view->grid.reference_mm;
    const double outside_mm = OUTSIDE_SHARE * view->texel_mm;
    if (!(height < outside_mm) || !(height > -view->grid.depth_mm - outside_mm))
        return -1;
    return (float)MAX(range - (double)sample->onset_mm[k], 0);
}

/* Returns the depth of one frame of the sweep in mm, along the ray to the grid's centre. */
static double coverage_view_frame_mm(const CoverageView *view, const struct laser_sweep *sweep) {
    const struct vec3 middle = vec3(0, 0, view->grid.reference_mm);
    const struct vec3 ray = vec3_unit(vec3_sub(middle, view->centre_mm));
    const struct vec3 source = rig_laser_position_mm(sweep->arc, sweep->laser, sweep->arc_rad);
    const struct rig_plane sheet =
        rig_laser_sheet(sweep->arc, sweep->laser, sweep->arc_rad,
                        rig_laser_sweep_rad(sweep->arc, sweep->laser, sweep->arc_rad, middle));
    return fabs(sweep->step_rad) * vec3_length(vec3_sub(middle, source)) /
           MAX(fabs(vec3_dot(sheet.normal, ray)), MIN_SINE);
}

gboolean coverage_view_add(CoverageView *view, int sweep, const struct session_shot *shot,
                           const struct input *input, GError **error) {
    static const char *const channels[] = {"peak", "second_peak", NULL};
    g_return_val_if_fail(sweep >= 0 && sweep < COVERAGE_MAX_SWEEPS && shot->sweep_steps > 1, FALSE);
    g_autoptr(ExrPart) part = input_read(input, channels, error);
    if (!part)
        return FALSE;
    const double from_rad = RAD(shot->sweep_from_deg), to_rad = RAD(shot->sweep_to_deg);
    const struct laser_sweep s = {.arc = &view->rig->arc,
                                  .laser = &view->rig->lasers[shot->device],
                                  .arc_rad = RAD(shot->arc_deg),
                                  .from_rad = from_rad,
                                  .step_rad = (to_rad - from_rad) / (shot->sweep_steps - 1)};
    const struct laser_sheets sheets = laser_lines_sheets(&s);
    const float *peaks[2] = {exr_part_plane(part, "peak"), exr_part_plane(part, "second_peak")};
    gboolean live[4];
    phases(part, peaks[0], live);
    struct seen *seen = g_new(struct seen, view->samples->len + 1);
    for (guint i = 0; i < view->samples->len; i++) {
        const struct sample *sample = &g_array_index(view->samples, struct sample, i);
        /* of the four pixels around the texel, the first is used whose phase sees the laser */
        int k = 0;
        while (k < 3 && !live[2 * ((sample->y + (k >> 1)) & 1) + ((sample->x + (k & 1)) & 1)])
            k++;
        const gsize pixel =
            (gsize)(sample->y + (k >> 1)) * (gsize)part->width + (gsize)(sample->x + (k & 1));
        for (int rank = 0; rank < 2; rank++)
            seen[i].mm[rank] = distance(view, &sheets, sample, k, peaks[rank][pixel]);
    }
    view->frame_mm[sweep] = coverage_view_frame_mm(view, &s);
    g_free(view->seen[sweep]);
    view->seen[sweep] = seen;
    return TRUE;
}

/* Returns the set of sweeps that saw something at a sample. ret_agree receives the largest number
 * of them that agree. */
static guint64 coverage_view_lit(const CoverageView *view, guint sample, int *ret_agree) {
    guint64 lit = 0;
    *ret_agree = 0;
    for (int i = 0; i < COVERAGE_MAX_SWEEPS; i++) {
        if (!view->seen[i])
            continue;
        const float *mm = view->seen[i][sample].mm;
        if (mm[0] >= 0 || mm[1] >= 0)
            lit |= (guint64)1 << i;
        for (int rank = 0; rank < 2; rank++) {
            int agree = 1;
            if (mm[rank] < 0)
                continue;
            for (int k = 0; k < COVERAGE_MAX_SWEEPS; k++) {
                if (k == i || !view->seen[k])
                    continue;
                const float *other = view->seen[k][sample].mm;
                const double close = MAX(view->agreement_mm,
                                         FRAME_SHARE * MAX(view->frame_mm[i], view->frame_mm[k]));
                agree += (other[0] >= 0 && fabs((double)(other[0] - mm[rank])) <= close) ||
                         (other[1] >= 0 && fabs((double)(other[1] - mm[rank])) <= close);
            }
            *ret_agree = MAX(*ret_agree, agree);
        }
    }
    return lit;
}

static gboolean knows(guint64 lit, int agree) {
    return agree >= AGREE && 2 * agree >= __builtin_popcountll(lit);
}

static int compare(gconstpointer a, gconstpointer b) {
    const guint64 x = *(const guint64 *)a, y = *(const guint64 *)b;
    return (x > y) - (x < y);
}

/* Sorts `open`. Equal patterns of sweeps are then next to each other, as coverage_view_expects()
 * needs them. */
struct coverage_sums coverage_view_sum_up(CoverageView *view) {
    struct coverage_sums sums = {.texels = (int)view->samples->len};
    g_array_set_size(view->open, 0);
    for (guint i = 0; i < view->samples->len; i++) {
        int agree;
        const guint64 lit = coverage_view_lit(view, i, &agree);
        if (knows(lit, agree))
            sums.known++;
        else
            g_array_append_val(view->open, lit);
    }
    g_array_sort(view->open, compare);
    return sums;
}

double coverage_view_expects(const CoverageView *view, const CoverageModel *model, int sweep) {
    guint64 taken = 0;
    double sum = 0;
    for (int i = 0; i < COVERAGE_MAX_SWEEPS; i++)
        if (view->seen[i])
            taken |= (guint64)1 << i;
    for (guint i = 0, n; i < view->open->len; i += n) {
        const guint64 lit = g_array_index(view->open, guint64, i);
        for (n = 1; i + n < view->open->len && g_array_index(view->open, guint64, i + n) == lit;)
            n++;
        sum += n * coverage_model_lights(model, taken, lit, sweep) * (lit ? 1 : 0.5);
    }
    return view->samples->len > 0 ? sum / view->samples->len : 0;
}
