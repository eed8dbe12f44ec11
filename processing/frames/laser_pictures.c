#include "laser_pictures.h"

#include "base/robust.h"

#include <math.h>
#include <stdlib.h>

/* pixels: standard deviation of the Gaussian, which averages over the 2 × 2 pixels of a colour
 * filter */
#define SIGMA_PX 1.5
#define REACH    4 /* pixels: half width of the filter */
#define FEWEST   6 /* minimum number of candidates of a line */
/* Number of fits of a line. After each fit, candidates that are farther from the line than OUTLIER
 * standard deviations are left out. */
#define ROUNDS  3
#define OUTLIER 2.5

struct LaserPictures {
    const LaserRegion *region;
    const struct laser_sweep *sweep;
    int width, height, n_frames, frame;
    double threshold_dn;
    /* whether the line crosses the rows, so that there is one candidate per row */
    gboolean along_rows;
    /* For each pixel, with the point x of the plane that the pixel sees:
     * angle: sweep angle at which the calibrated sheet passes x, in rad; NAN outside of the
     * region
     * along: tangent of the angle between the beam and the direction to x */
    double *angle, *along;
    float weights[REACH + 1];
    /* For each frame:
     * turn: deviation of the sheet's angle, in rad
     * roll: roll of the sheet, in rad
     * candidates: number of candidates; 0 if there is no line */
    float *turn, *roll, *candidates;
};

/* Sets the members angle, along and along_rows. */
static void place(LaserPictures *p) {
    const struct laser_sweep *s = p->sweep;
    const struct vec3 source = rig_laser_position_mm(s->arc, s->laser, s->arc_rad);
    const struct vec3 axis = rig_laser_axis(s->arc, s->laser, s->arc_rad);
    for (int k = 0; k < p->width * p->height; k++)
        p->angle[k] = NAN;
    for (int k = 0; k < laser_region_pixels(p->region); k++) {
        struct vec3 at;
        const guint32 index = laser_region_pixel(p->region, k, &at);
        const struct vec3 path = vec3_sub(at, source);
        const double aside = vec3_dot(path, axis);
        p->angle[index] = rig_laser_sweep_rad(s->arc, s->laser, s->arc_rad, at);
        p->along[index] = aside / sqrt(MAX(vec3_dot(path, path) - aside * aside, 1e-6));
    }
    /* sums of the changes of the angle from column to column, and from row to row */
    double across = 0, down = 0;
    for (int k = 0; k + p->width < p->width * p->height; k++) {
        const gboolean is_last = k % p->width == p->width - 1;
        across += !is_last && isfinite(p->angle[k + 1]) && isfinite(p->angle[k])
                      ? fabs(p->angle[k + 1] - p->angle[k])
                      : 0;
        down += isfinite(p->angle[k + p->width]) && isfinite(p->angle[k])
                    ? fabs(p->angle[k + p->width] - p->angle[k])
                    : 0;
    }
    p->along_rows = across > down;
}

LaserPictures *laser_pictures_new(const LaserRegion *region, const struct laser_sweep *sweep,
                                  int width, int height, int n_frames, double threshold_dn) {
    LaserPictures *p = g_new0(LaserPictures, 1);
    *p = (LaserPictures){.region = region,
                         .sweep = sweep,
                         .width = width,
                         .height = height,
                         .n_frames = n_frames,
                         .threshold_dn = threshold_dn};
    p->angle = g_new(double, (gsize)width *height);
    p->along = g_new0(double, (gsize)width *height);
    p->turn = g_new0(float, n_frames);
    p->roll = g_new0(float, n_frames);
    p->candidates = g_new0(float, n_frames);
    double sum = 0;
    for (int k = -REACH; k <= REACH; k++)
        sum += exp(-k * k / (2 * SIGMA_PX * SIGMA_PX));
    for (int k = 0; k <= REACH; k++)
        p->weights[k] = (float)(exp(-k * k / (2 * SIGMA_PX * SIGMA_PX)) / sum);
    place(p);
    return p;
}

void laser_pictures_free(LaserPictures *p) {
    if (!p)
        return;
    g_free(p->angle);
    g_free(p->along);
    g_free(p->turn);
    g_free(p->roll);
    g_free(p->candidates);
    g_free(p);
}

/* Filters n_lines rows or columns of n values with the Gaussian. In memory, successive values are
 * step apart, and successive rows or columns line_step. At the borders the last value is
 * repeated. */
static void filter_lines(const LaserPictures *p, const float *from, int n_lines, int line_step,
                         int n, int step, float *to) {
    for (int line = 0; line < n_lines; line++)
        for (int i = 0; i < n; i++) {
            float sum = 0;
            for (int k = -REACH; k <= REACH; k++)
                sum += p->weights[abs(k)] * from[line * line_step + CLAMP(i + k, 0, n - 1) * step];
            to[line * line_step + i * step] = sum;
        }
}

static float *filter_picture(const LaserPictures *p, const guint16 *pixels) {
    const int n = p->width * p->height;
    float *ret = g_new0(float, n);
    g_autofree float *half = g_new(float, n);
    for (int k = 0; k < n; k++)
        ret[k] = pixels[k];
    filter_lines(p, ret, p->height, p->width, p->width, 1, half);
    filter_lines(p, half, p->width, 1, p->height, p->width, ret);
    return ret;
}

struct found {
    double angle, along;
};

static int laser_pictures_candidates(const LaserPictures *p, const float *picture, double least,
                                     struct found *ret) {
    const int n_lines = p->along_rows ? p->height : p->width,
              length = p->along_rows ? p->width : p->height;
    const int line_step = p->along_rows ? p->width : 1, step = p->along_rows ? 1 : p->width;
    int n = 0;
    for (int line = 0; line < n_lines; line++) {
        int best = -1;
        for (int i = 0; i < length; i++) {
            const int k = line * line_step + i * step;
            if (isfinite(p->angle[k]) && (double)picture[k] > least &&
                (best < 0 || picture[k] > picture[best]))
                best = k;
        }
        if (best >= 0)
            ret[n++] = (struct found){p->angle[best], p->along[best]};
    }
    return n;
}

/* Fits angle = turn + roll · along by least squares, and removes outliers from f. Returns the
 * number of candidates used, or 0 if there are too few or if they do not determine the roll. */
static int fit_line(struct found *f, int n, double *ret_turn, double *ret_roll) {
    for (int round = 0; round <= ROUNDS && n >= FEWEST; round++) {
        double a = 0, o = 0, aa = 0, ao = 0, squares = 0;
        for (int i = 0; i < n; i++) {
            a += f[i].along / n;
            o += f[i].angle / n;
        }
        for (int i = 0; i < n; i++) {
            aa += (f[i].along - a) * (f[i].along - a);
            ao += (f[i].along - a) * (f[i].angle - o);
        }
        if (!(aa > 1e-9))
            return 0;
        *ret_roll = ao / aa;
        *ret_turn = o - *ret_roll * a;
        for (int i = 0; i < n; i++)
            squares += pow(f[i].angle - *ret_turn - *ret_roll * f[i].along, 2) / n;
        const double most = OUTLIER * sqrt(squares) + 1e-9;
        int kept = 0;
        for (int i = 0; i < n && round < ROUNDS; i++)
            if (fabs(f[i].angle - *ret_turn - *ret_roll * f[i].along) <= most)
                f[kept++] = f[i];
        n = round < ROUNDS ? kept : n;
    }
    return n >= FEWEST ? n : 0;
}

void laser_pictures_add(LaserPictures *p, const guint16 *pixels) {
    g_return_if_fail(p->frame < p->n_frames);
    const int n = laser_region_pixels(p->region), frame = p->frame++;
    if (n == 0)
        return;
    g_autofree float *picture = filter_picture(p, pixels);
    g_autofree double *region = g_new(double, n);
    for (int k = 0; k < n; k++)
        region[k] = picture[laser_region_pixel(p->region, k, NULL)];
    g_autofree struct found *found = g_new(struct found, MAX(p->width, p->height));
    const int n_found =
        laser_pictures_candidates(p, picture, robust_median(region, n) + p->threshold_dn, found);
    double turn, roll;
    const int counted = fit_line(found, n_found, &turn, &roll);
    if (counted == 0)
        return;
    p->turn[frame] = (float)(turn - (p->sweep->from_rad + frame * p->sweep->step_rad));
    p->roll[frame] = (float)roll;
    p->candidates[frame] = (float)counted;
}

void laser_pictures_finish(const LaserPictures *p, struct laser_lines *ret) {
    const struct laser_sweep *s = p->sweep;
    const struct vec3 axis = rig_laser_axis(s->arc, s->laser, s->arc_rad);
    *ret = (struct laser_lines){.n_frames = p->n_frames};
    ret->source_mm = rig_laser_position_mm(s->arc, s->laser, s->arc_rad);
    const struct vec3 inward = vec3_scale(ret->source_mm, -1);
    ret->beam = vec3_unit(vec3_sub(inward, vec3_scale(axis, vec3_dot(inward, axis))));
    double roll = 0, weight = 0, offset = 0;
    for (int k = 0; k < p->frame; k++) {
        ret->frames += p->candidates[k] > 0;
        ret->pixels += (int)p->candidates[k];
        weight += p->candidates[k];
        roll += p->candidates[k] * p->roll[k];
        offset += p->candidates[k] * p->turn[k];
    }
    if (ret->frames == 0)
        return;
    ret->roll_rad = ret->roll_seen_rad = roll / weight;
    ret->offset_rad = offset / weight;
    ret->roll_error_rad = ret->offset_error_rad = INFINITY; /* unknown */
    ret->turn_rad = g_new0(float, p->n_frames);
    for (int k = 0; k < p->n_frames; k++) {
        int nearest = -1;
        for (int i = 0; i < p->frame; i++)
            if (p->candidates[i] > 0 && (nearest < 0 || abs(i - k) < abs(nearest - k)))
                nearest = i;
        ret->turn_rad[k] = p->turn[nearest];
    }
}
