#include "laser_lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/robust.h"
#include "laser_frames.h"

#define MARK_SHARE  0.25 /* margin around a fiducial, as a share of its radius */
#define MIN_PIXELS  64   /* minimum number of pixels with a peak in a sweep */
#define MIN_FRAME   6    /* minimum number of pixels with a peak in a frame */
#define ROUNDS      6
#define BEND_ROUNDS 4 /* number of rounds in the intersection of a ray with a bent sheet */
/* a difference is significant if it is larger than this number of standard errors */
#define MANY 4.0
#define OFF_SHARE                                                                                  \
    0.25 /* maximum share of the frames of a sweep that may contradict the calibration */
/* Lower bounds of the calibration's standard errors for the whole sweep (15 µm at half a metre) and
 * for single frames. These bounds are needed because a sheet is not exactly a plane, and because
 * axes step unevenly. */
#define MIN_KNOWN_RAD 3e-5
#define MIN_FRAME_RAD 2e-4

struct pixel {
    guint32 index;
    struct vec3 at_mm;  /* point where the pixel's ray meets the reference plane, rig frame */
    struct vec3 per_mm; /* derivative of at_mm with respect to the plane's height */
};

struct LaserRegion {
    GArray *pixels;
    struct laser_reference reference;
    double turntable_rad;
};

char *laser_reference_to_text(const struct laser_reference *reference) {
    const double values[] = {reference->plane_mm, reference->plane_error_mm, reference->hole_mm[0],
                             reference->hole_mm[1], reference->radius_mm};
    GString *text = g_string_new(NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++) {
        char number[G_ASCII_DTOSTR_BUF_SIZE];
        g_string_append_printf(text, "%s%s", i ? ";" : "",
                               g_ascii_dtostr(number, sizeof number, values[i]));
    }
    return g_string_free(text, FALSE);
}

gboolean laser_reference_from_text(const char *text, struct laser_reference *ret) {
    double values[5];
    g_auto(GStrv) words = text ? g_strsplit(text, ";", 6) : NULL;
    if (!words || g_strv_length(words) != G_N_ELEMENTS(values))
        return FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++) {
        char *end = NULL;
        values[i] = g_ascii_strtod(words[i], &end);
        if (end == words[i] || *end || !isfinite(values[i]) || values[i] < 0)
            return FALSE;
    }
    *ret = (struct laser_reference){.plane_mm = values[0],
                                    .plane_error_mm = values[1],
                                    .hole_mm = {values[2], values[3]},
                                    .radius_mm = values[4]};
    return TRUE;
}

/* Returns whether the sample's box cuts the segment between two points in the sample frame (slab
 * method). */
static gboolean is_behind(const struct laser_reference *r, struct vec3 point, struct vec3 other) {
    const double from[3] = {point.x, point.y, point.z}, to[3] = {other.x, other.y, other.z};
    const double low[3] = {-r->hole_mm[0] / 2, -r->hole_mm[1] / 2, r->plane_mm};
    const double high[3] = {r->hole_mm[0] / 2, r->hole_mm[1] / 2, MAX(r->top_mm, r->plane_mm)};
    double enter = 0, leave = 1;
    for (int i = 0; i < 3; i++) {
        const double extent = to[i] - from[i];
        if (fabs(extent) < 1e-12) {
            if (from[i] < low[i] || from[i] > high[i])
                return FALSE;
            continue;
        }
        const double a = (low[i] - from[i]) / extent, b = (high[i] - from[i]) / extent;
        enter = MAX(enter, MIN(a, b));
        leave = MIN(leave, MAX(a, b));
    }
    return enter < leave;
}

/* Returns whether a camera at `eye` sees the flat face at `point`. Returns FALSE outside of the
 * face, in the hole, on a fiducial, and where the sample hides the face. Both positions are in the
 * sample frame. */
static gboolean shows_plane(const struct rig *rig, const struct laser_reference *reference,
                            struct vec3 point, struct vec3 eye) {
    const gboolean in_hole =
        fabs(point.x) <= reference->hole_mm[0] / 2 && fabs(point.y) <= reference->hole_mm[1] / 2;
    if (!(hypot(point.x, point.y) < reference->radius_mm) || in_hole)
        return FALSE;
    for (int i = 0; i < rig->n_fiducials; i++) {
        const struct rig_fiducial *mark = &rig->fiducials[i];
        const double x = point.x - mark->centre_mm.x, y = point.y - mark->centre_mm.y;
        if (hypot(x, y) < (1 + MARK_SHARE) * mark->radius_mm + fabs(mark->centre_mm.z))
            return FALSE;
    }
    return !is_behind(reference, point, eye);
}

/* Intersects each pixel's ray c + t·d with the plane z = plane_mm: t = (plane_mm − c_z) / d_z. */
LaserRegion *laser_region_new(const struct rig *rig, const struct rig_camera *camera,
                              double turntable_rad, const struct laser_reference *reference) {
    LaserRegion *region = g_new0(LaserRegion, 1);
    region->pixels = g_array_new(FALSE, FALSE, sizeof(struct pixel));
    region->reference = *reference;
    region->turntable_rad = turntable_rad;
    const struct vec3 centre = rig_camera_centre_mm(camera);
    const struct vec3 eye = rig_turn(centre, -turntable_rad);
    for (int i = 0; i < camera->width * camera->height && reference->radius_mm > 0; i++) {
        const int row = i / camera->width, column = i % camera->width;
        const struct vec3 ray = rig_pixel_ray(camera, column, row);
        if (!(ray.z < 0))
            continue;
        const double along = (reference->plane_mm - centre.z) / ray.z;
        const struct pixel pixel = {(guint32)i, vec3_add(centre, vec3_scale(ray, along)),
                                    vec3_scale(ray, 1 / ray.z)};
        if (shows_plane(rig, reference, rig_turn(pixel.at_mm, -turntable_rad), eye))
            g_array_append_val(region->pixels, pixel);
    }
    return region;
}

void laser_region_free(LaserRegion *region) {
    if (!region)
        return;
    g_array_unref(region->pixels);
    g_free(region);
}

int laser_region_pixels(const LaserRegion *region) {
    return (int)region->pixels->len;
}

guint32 laser_region_pixel(const LaserRegion *region, int i, struct vec3 *ret_at_mm) {
    const struct pixel *pixel = &g_array_index(region->pixels, struct pixel, i);
    if (ret_at_mm)
        *ret_at_mm = pixel->at_mm;
    return pixel->index;
}

/* A pixel of the region that saw the line. */
struct candidate {
    int frame;
    /* sweep angle of the calibrated sheet through the pixel's point, minus the angle commanded at
     * the time of the pixel's peak, in rad */
    double off;
    double along; /* position along the line: tangent of the angle from the beam */
};

/* The line fit of one sweep. The candidates of frame k have the indices first[k] … first[k + 1] −
 * 1, in order of off. Each member of struct candidate has an array of its own, because compilers
 * can vectorise loops over such arrays. */
struct search {
    double *off, *along; /* n: members of struct candidate */
    double *value;       /* n: off − roll · along */
    double *weight;      /* n: weight (Tukey's biweight) in the last fit */
    double *buffer;      /* n */
    int n, n_frames, *first;
    double *middle;  /* of each frame: robust mean of value; NAN if there are too few candidates */
    double *error;   /* standard error of middle, rad */
    double scale;    /* robust standard deviation of a pixel's residual, rad */
    double per_mm;   /* rad per mm: mean derivative of off with respect to the plane's height */
    double range_mm; /* mean distance of the candidates' points from the axis of the sweep */
};

static int by_off(const void *a, const void *b) {
    const struct candidate *x = a, *y = b;
    return (x->off > y->off) - (x->off < y->off);
}

/* Sets first, off and along from candidates in any order. */
static void sort_candidates(struct search *search, const struct candidate *candidates) {
    g_autofree struct candidate *sorted = g_new0(struct candidate, search->n + 1);
    g_autofree int *end = g_new0(int, search->n_frames);
    for (int i = 0; i < search->n; i++)
        search->first[candidates[i].frame + 1]++;
    for (int k = 0; k < search->n_frames; k++) {
        end[k] = search->first[k];
        search->first[k + 1] += search->first[k];
    }
    for (int i = 0; i < search->n; i++)
        sorted[end[candidates[i].frame]++] = candidates[i];
    for (int k = 0; k < search->n_frames; k++)
        qsort(sorted + search->first[k], (gsize)(end[k] - search->first[k]), sizeof *sorted,
              by_off);
    for (int i = 0; i < search->n; i++) {
        search->off[i] = sorted[i].off;
        search->along[i] = sorted[i].along;
    }
}

/* Collects the candidates: pixels with a peak, for which the sample did not block the light between
 * laser and face. off = α(x) − (from + peak·step), where α(x) is the sweep angle of the calibrated
 * sheet through the pixel's point x. */
static void collect(const LaserRegion *region, const struct laser_sweep *sweep,
                    struct search *search) {
    const struct rig_laser_pose pose = rig_laser_pose(sweep->arc, sweep->laser, sweep->arc_rad);
    const struct vec3 source = pose.position_mm, axis = pose.axis;
    const struct rig_rotation back = rig_rotation(-region->turntable_rad);
    const struct vec3 in_sample = rig_rotate(back, source);
    g_autofree struct candidate *candidates = g_new0(struct candidate, region->pixels->len + 1);
    double per_mm = 0;
    for (guint i = 0; i < region->pixels->len; i++) {
        const struct pixel *pixel = &g_array_index(region->pixels, struct pixel, i);
        const float peak = sweep->peak[pixel->index];
        if (!(peak > 0) || !(peak < (float)(search->n_frames - 1)) ||
            is_behind(&region->reference, rig_rotate(back, pixel->at_mm), in_sample))
            continue;
        const struct vec3 path = vec3_sub(pixel->at_mm, source);
        const double aside = vec3_dot(path, axis);
        const double range = sqrt(MAX(vec3_dot(path, path) - aside * aside, 1e-6));
        const double at = rig_laser_pose_sweep_rad(&pose, pixel->at_mm);
        const double above = rig_laser_pose_sweep_rad(&pose, vec3_add(pixel->at_mm, pixel->per_mm));
        candidates[search->n++] = (struct candidate){
            (int)lroundf(peak), at - (sweep->from_rad + peak * sweep->step_rad), aside / range};
        per_mm += above - at;
        search->range_mm += range;
    }
    search->per_mm = per_mm / MAX(search->n, 1);
    search->range_mm /= MAX(search->n, 1);
    sort_candidates(search, candidates);
}

/* Sets value for a roll. */
static void take_roll(struct search *search, double roll) {
    for (int i = 0; i < search->n; i++)
        search->value[i] = search->off[i] - roll * search->along[i];
}

/* Computes Tukey's biweight mean of n values: ROUNDS rounds that begin with their median. Returns
 * NAN if the sum of the weights is too small. */
static double biweight_mean(const double *value, double *weight, int n, double scale, double median,
                            double *ret_weights) {
    double middle = median, weights = n;
    for (int round = 0; round < ROUNDS && scale > 0 && isfinite(middle); round++) {
        double sum = 0;
        weights = 0;
        for (int i = 0; i < n; i++)
            weight[i] = robust_biweight(value[i] - middle, scale);
        for (int i = 0; i < n; i++) {
            weights += weight[i];
            sum += weight[i] * value[i];
        }
        middle = weights >= 0.5 * MIN_FRAME ? sum / weights : NAN;
    }
    *ret_weights = weights;
    return middle;
}

/* Computes the robust mean of off − roll·along over the candidates of each frame. Starts at the
 * median. If scale is known, ROUNDS rounds of Tukey's biweight mean follow. The standard error is
 * scale / √Σw. The mean is NAN if a frame has too few candidates. */
static void fit_frames(struct search *search, double roll) {
    take_roll(search, roll);
    for (int frame = 0; frame < search->n_frames; frame++) {
        const int from = search->first[frame], n = search->first[frame + 1] - from;
        const double *value = search->value + from;
        search->middle[frame] = NAN;
        if (n < MIN_FRAME)
            continue;
        memcpy(search->buffer, value, sizeof *value * (gsize)n);
        double weights;
        const double middle = biweight_mean(value, search->weight + from, n, search->scale,
                                            robust_median(search->buffer, n), &weights);
        if (!isfinite(middle))
            continue;
        search->middle[frame] = middle;
        search->error[frame] = search->scale / sqrt(weights);
    }
}

/* Sets scale to the robust standard deviation of the residuals off − roll·along − middle[frame]. */
static void measure_scale(struct search *search, double roll) {
    int n = 0;
    take_roll(search, roll);
    for (int k = 0; k < search->n_frames; k++) {
        if (!isfinite(search->middle[k]))
            continue;
        for (int i = search->first[k]; i < search->first[k + 1]; i++)
            search->buffer[n++] = search->value[i] - search->middle[k];
    }
    search->scale = n > 0 ? MAX(robust_spread(search->buffer, n, 0), 1e-9) : 0;
}

/* Fits the roll with one intercept for each frame. The roll is the slope that the lines of all
 * frames have in common:
 *   roll = Σ w (a − ā_k)(o − ō_k) / Σ w (a − ā_k)²,
 * with a: along, o: off, bars: weighted means in frame k, w: biweight of the residual. Returns
 * FALSE if the roll cannot be determined. */
static gboolean fit_roll(struct search *search, double *roll, double *ret_error) {
    const double *off = search->off, *along = search->along;
    double product = 0, square = 0;
    take_roll(search, *roll);
    for (int k = 0; k < search->n_frames; k++) {
        const int first = search->first[k], last = search->first[k + 1];
        const double middle = search->middle[k];
        double weights = 0, off_sum = 0, along_sum = 0;
        if (!isfinite(middle))
            continue;
        for (int i = first; i < last; i++)
            search->weight[i] = robust_biweight(search->value[i] - middle, search->scale);
        for (int i = first; i < last; i++) {
            const double w = search->weight[i];
            weights += w;
            off_sum += w * off[i];
            along_sum += w * along[i];
        }
        for (int i = first; weights > 0 && i < last; i++) {
            const double from_mean = along[i] - along_sum / weights;
            product += search->weight[i] * from_mean * (off[i] - off_sum / weights);
            square += search->weight[i] * from_mean * from_mean;
        }
    }
    if (!(square > 1e-9))
        return FALSE;
    *roll = product / square;
    *ret_error = search->scale / sqrt(square);
    return TRUE;
}

/* Returns whether a measured deviation is significant, given the standard errors of the measurement
 * and of the calibration. */
static gboolean disagree(double measured, double error, double known) {
    return fabs(measured) > MANY * hypot(error, known);
}

/* Combines the lines with the calibration. The lines give the offset m with the standard error e,
 * and the calibration has the standard error c. The combined offset is m·c² / (c² + e²). If lines
 * and calibration disagree, the offset is m. The correction of the angle of frame k is offset +
 * (level_k − m) + own_k. */
static void combine(const struct search *search, const struct laser_known *known,
                    double plane_error_rad, struct laser_lines *lines) {
    const int n = search->n_frames;
    g_autofree double *level = g_new(double, n), *own = g_new(double, n);
    struct laser_frames frames = {n, search->middle, search->error, level, own};
    const double frame_known = hypot(known->turn_rad, MIN_FRAME_RAD);
    laser_frames_settle(&frames);
    lines->frames = frames.lines;
    lines->offset_rad = frames.offset;
    lines->offset_error_rad = hypot(frames.offset_error, plane_error_rad);
    for (int k = 0; k < n; k++) {
        if (!isfinite(search->middle[k]))
            continue;
        lines->pixels += search->first[k + 1] - search->first[k];
        lines->frames_off += disagree(level[k], lines->offset_error_rad, frame_known);
    }
    const gboolean off = disagree(lines->offset_rad, lines->offset_error_rad, known->turn_rad) ||
                         lines->frames_off > OFF_SHARE * lines->frames;
    const double whole =
        off ? lines->offset_rad
            : robust_shrink(lines->offset_rad, lines->offset_error_rad, known->turn_rad);
    lines->disagrees |= off;
    lines->turn_rad = g_new0(float, n);
    for (int k = 0; k < n; k++)
        lines->turn_rad[k] = (float)(whole + level[k] - lines->offset_rad + own[k]);
}

/* Alternates between intercepts (middle), scale and roll. Then combines the roll with the
 * calibration's roll and fits all frames once more. Returns FALSE if no frame has a line. */
static gboolean do_find(struct search *search, const struct laser_known *known,
                        struct laser_lines *lines) {
    double roll = 0;
    lines->roll_error_rad = INFINITY;
    fit_frames(search, 0);
    for (int round = 0; round < ROUNDS; round++) {
        measure_scale(search, roll);
        if (!(search->scale > 0) || !fit_roll(search, &roll, &lines->roll_error_rad))
            return FALSE;
        fit_frames(search, roll);
    }
    lines->roll_seen_rad = roll;
    lines->disagrees = disagree(roll, lines->roll_error_rad, known->roll_rad);
    lines->roll_rad =
        lines->disagrees ? roll : robust_shrink(roll, lines->roll_error_rad, known->roll_rad);
    fit_frames(search, lines->roll_rad);
    measure_scale(search, lines->roll_rad);
    for (int k = 0; k < search->n_frames; k++)
        if (isfinite(search->middle[k]))
            return TRUE;
    return FALSE;
}

void laser_lines_find(const LaserRegion *region, const struct laser_sweep *sweep, int n_frames,
                      const struct laser_known *known, struct laser_lines *ret) {
    const struct laser_known least = {hypot(known->turn_rad, MIN_KNOWN_RAD),
                                      hypot(known->roll_rad, MIN_KNOWN_RAD)};
    struct search search = {.n_frames = n_frames};
    *ret = (struct laser_lines){.n_frames = n_frames};
    g_autofree double *arrays = g_new(double, 5 * ((gsize)region->pixels->len + 1));
    double **const of[] = {&search.off, &search.along, &search.value, &search.weight,
                           &search.buffer};
    for (gsize i = 0; i < G_N_ELEMENTS(of); i++)
        *of[i] = arrays + i * ((gsize)region->pixels->len + 1);
    search.first = g_new0(int, n_frames + 1);
    search.middle = g_new(double, n_frames);
    search.error = g_new0(double, n_frames);
    collect(region, sweep, &search);
    /* The beam points from the source towards the origin, and is perpendicular to the sweep's
     * axis. */
    const struct vec3 axis = rig_laser_axis(sweep->arc, sweep->laser, sweep->arc_rad);
    ret->source_mm = rig_laser_position_mm(sweep->arc, sweep->laser, sweep->arc_rad);
    const struct vec3 inward = vec3_scale(ret->source_mm, -1);
    ret->beam = vec3_unit(vec3_sub(inward, vec3_scale(axis, vec3_dot(inward, axis))));
    if (search.n >= MIN_PIXELS && do_find(&search, &least, ret)) {
        combine(&search, &least, fabs(search.per_mm) * region->reference.plane_error_mm, ret);
        ret->scatter_mm = search.scale * search.range_mm;
    }
    g_free(search.first);
    g_free(search.middle);
    g_free(search.error);
}

void laser_lines_clear(struct laser_lines *lines) {
    g_clear_pointer(&lines->turn_rad, g_free);
}

struct laser_sheets laser_lines_sheets(const struct laser_sweep *sweep) {
    const double roll_rad = sweep->lines ? sweep->lines->roll_rad : 0;
    return (struct laser_sheets){sweep, rig_laser_pose(sweep->arc, sweep->laser, sweep->arc_rad),
                                 rig_rotation(roll_rad)};
}

/* Returns the correction of the sweep angle at a fractional frame index, interpolated linearly
 * between frames. */
static double turn_at(const struct laser_lines *lines, double frame) {
    if (!lines || !lines->turn_rad)
        return 0;
    const double at = CLAMP(frame, 0, lines->n_frames - 1);
    const int k = MIN((int)at, MAX(lines->n_frames - 2, 0));
    const double a = lines->turn_rad[k], b = lines->turn_rad[MIN(k + 1, lines->n_frames - 1)];
    return a + (b - a) * (at - k);
}

/* Returns the plane of light at a sweep angle. The sheet's bend is ignored. */
static struct rig_plane sheet_at(const struct laser_sheets *sheets, double sweep_rad) {
    const struct laser_lines *lines = sheets->sweep->lines;
    struct rig_plane sheet = rig_laser_pose_sheet(&sheets->pose, sweep_rad);
    if (!lines || !lines->turn_rad || lines->roll_rad == 0)
        return sheet;
    /* With a positive roll, the sheet meets points with a larger coordinate along the axis at a
     * larger sweep angle. */
    const struct vec3 aside = vec3_cross(sheet.normal, lines->beam);
    sheet.normal = vec3_unit(vec3_add(vec3_scale(sheet.normal, sheets->roll.cosine),
                                      vec3_scale(aside, sheets->roll.sine)));
    sheet.offset_mm = vec3_dot(sheet.normal, lines->source_mm);
    return sheet;
}

/* A ray c + t·r meets the plane n·x = d at t = (d − n·c) / (n·r). For a bent sheet, each round
 * turns the plane by the bend at the point that the previous round found. The rounds converge fast,
 * because along a ray the bend changes by only some hundredths of a radian per radian. */
double laser_lines_range_mm(const struct laser_sheets *sheets, double frame, struct vec3 eye_mm,
                            struct vec3 ray, double least_sine) {
    const int rounds = sheets->sweep->laser->bend_rad == 0 ? 1 : BEND_ROUNDS;
    const double sweep_rad = sheets->sweep->from_rad + frame * sheets->sweep->step_rad;
    const double turn_rad = turn_at(sheets->sweep->lines, frame);
    double range_mm = NAN, more_rad = 0;
    for (int round = 0; round < rounds; round++) {
        const struct rig_plane sheet = sheet_at(sheets, sweep_rad + more_rad + turn_rad);
        const double sine = vec3_dot(sheet.normal, ray);
        if (!(fabs(sine) > least_sine))
            return NAN;
        range_mm = (sheet.offset_mm - vec3_dot(sheet.normal, eye_mm)) / sine;
        more_rad =
            rig_laser_pose_bent_rad(&sheets->pose, vec3_add(eye_mm, vec3_scale(ray, range_mm)));
    }
    return range_mm;
}
