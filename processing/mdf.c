#include "mdf.h"

#include <math.h>
#include <stdlib.h>

#include "rectify.h"

#define LEAST_ANGLE     0.03 /* sine between ray and sheet: below it depth is noise */
#define ABOVE_MM        0.5  /* how far above the reference plane a point may seem to lie */
#define BELOW_MM        1.0  /* and below the deepest structure */
#define LEAST_AGREEMENT 0.1  /* mm: results of two lasers this close are never outliers */
#define SEEN_SHARE      0.6f /* of the pixels around a texel */
#define LIVE_SHARE      0.25 /* of what the best phase of the colour filter sees */
#define FAINT           0.5  /* of the brightest line at a texel: it counts half */
#define MANY_SWEEPS     4    /* with as many, one alone is not believed */

struct MdfView {
    struct rig_camera camera;
    struct vec3 centre_mm;
    struct session_grid grid;
    int n_texels, n_sweeps;
    float agreement_mm; /* pixels side by side whose distances differ more show different things */
    float *ray;         /* of each pixel: unit vector in the rig frame, three values */
    float *onset_mm;    /* of each pixel: along its ray from the centre to the reference plane */
    float *x_px, *y_px; /* of each texel's centre; x < 0: outside of the picture */
    float *pixel_mm;    /* of each pixel, for one sweep: distance from the reference plane, −1 */
    float *texel_mm[MDF_MAX_SWEEPS], *texel_dn[MDF_MAX_SWEEPS]; /* distance, how bright */
    double weight[MDF_MAX_SWEEPS];
};

static void trace_pixels(MdfView *view) {
    const struct rig_camera *camera = &view->camera;
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            gsize i = (gsize)y * camera->width + x;
            struct vec3 ray = rig_pixel_ray(camera, x, y);
            view->ray[3 * i] = (float)ray.x;
            view->ray[3 * i + 1] = (float)ray.y;
            view->ray[3 * i + 2] = (float)ray.z;
            view->onset_mm[i] = (float)((view->grid.reference_mm - view->centre_mm.z) / ray.z);
        }
}

static void project_texels(MdfView *view, double turntable_rad) {
    const struct session_grid *grid = &view->grid;
    for (int i = 0; i < view->n_texels; i++) {
        int row = i / grid->width, column = i % grid->width;
        struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
        double x, y;
        gboolean inside = rig_project(&view->camera, rig_turn(p, turntable_rad), &x, &y) &&
                          x >= 0 && y >= 0 && x <= view->camera.width - 1 &&
                          y <= view->camera.height - 1;
        view->x_px[i] = inside ? (float)x : -1;
        view->y_px[i] = inside ? (float)y : -1;
    }
}

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid) {
    gsize n_pixels = (gsize)camera->width * camera->height;
    MdfView *view = g_new0(MdfView, 1);
    view->camera = *camera;
    view->centre_mm = rig_camera_centre_mm(camera);
    view->grid = *grid;
    view->n_texels = grid->width * grid->height;
    view->ray = g_new(float, n_pixels * 3);
    view->onset_mm = g_new(float, n_pixels);
    view->pixel_mm = g_new(float, n_pixels);
    view->x_px = g_new(float, view->n_texels);
    view->y_px = g_new(float, view->n_texels);
    double slant = view->centre_mm.z / vec3_length(view->centre_mm);
    view->agreement_mm = (float)(grid->width_mm / grid->width / MAX(slant, 0.1));
    trace_pixels(view);
    project_texels(view, turntable_rad);
    return view;
}

void mdf_view_free(MdfView *view) {
    if (!view)
        return;
    for (int i = 0; i < view->n_sweeps; i++) {
        g_free(view->texel_mm[i]);
        g_free(view->texel_dn[i]);
    }
    g_free(view->ray);
    g_free(view->onset_mm);
    g_free(view->pixel_mm);
    g_free(view->x_px);
    g_free(view->y_px);
    g_free(view);
}

double mdf_weight(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                  struct vec3 camera_mm) {
    struct vec3 centre = vec3(0, 0, 0), up = vec3(0, 0, 1);
    double sweep_rad = rig_laser_sweep_rad(arc, laser, arc_rad, centre);
    struct vec3 line = vec3_cross(rig_laser_sheet(arc, laser, arc_rad, sweep_rad).normal, up);
    if (!(vec3_length(line) > 1e-9))
        return 0;
    struct vec3 a = vec3_unit(line), b = vec3_scale(a, -1);
    struct vec3 source = vec3_sub(rig_laser_position_mm(arc, laser, arc_rad), a);
    struct vec3 camera = vec3_sub(camera_mm, a), along = vec3_sub(b, a);
    return fabs(vec3_dot(source, vec3_cross(camera, along))) / 6;
}

static float intersect(const MdfView *view, const struct mdf_sweep *sweep, gsize pixel) {
    float peak = sweep->peak[pixel];
    if (!(peak >= 0) || !isfinite(peak))
        return -1;
    const float *r = view->ray + 3 * pixel;
    struct vec3 ray = vec3(r[0], r[1], r[2]);
    struct rig_plane sheet = rig_laser_sheet(sweep->arc, sweep->laser, sweep->arc_rad,
                                             sweep->from_rad + peak * sweep->step_rad);
    double sine = vec3_dot(sheet.normal, ray);
    if (!(fabs(sine) > LEAST_ANGLE) || !(ray.z < 0))
        return -1;
    double range = (sheet.offset_mm - vec3_dot(sheet.normal, view->centre_mm)) / sine;
    double height = view->centre_mm.z + range * ray.z - view->grid.reference_mm;
    if (!(height < ABOVE_MM) || !(height > -view->grid.depth_mm - BELOW_MM))
        return -1;
    return (float)MAX(range - view->onset_mm[pixel], 0);
}

/* Which of the four phases of a colour filter see this laser: all, or those of its colour. */
struct phases {
    gboolean live[4];
    int radius; /* pixels to the next one that sees it, at most */
};

static int phase_of(int x, int y) {
    return 2 * (y & 1) + (x & 1);
}

static struct phases find_phases(const MdfView *view) {
    struct phases phases = {.radius = 1};
    int seen[4] = {0}, most = 0, width = view->camera.width;
    for (int y = 0; y < view->camera.height; y++)
        for (int x = 0; x < width; x++)
            seen[phase_of(x, y)] += view->pixel_mm[(gsize)y * (gsize)width + (gsize)x] >= 0;
    for (int k = 0; k < 4; k++)
        most = MAX(most, seen[k]);
    for (int k = 0; k < 4; k++) {
        phases.live[k] = seen[k] > LIVE_SHARE * most;
        phases.radius = phases.live[k] ? phases.radius : 2;
    }
    return phases;
}

struct near {
    float mm, dn, share; /* share of a bilinear mean */
};

/* The pixels around a point that could have seen the laser; mm is −1 for those that have not. */
static int find_near(const MdfView *view, const struct phases *phases, const float *intensity,
                     float x, float y, struct near *ret) {
    int n = 0, r = phases->radius, i = (int)floorf(x), j = (int)floorf(y);
    for (int v = j - r + 1; v <= j + r; v++)
        for (int u = i - r + 1; u <= i + r; u++) {
            float share = (1 - fabsf(x - u) / r) * (1 - fabsf(y - v) / r);
            if (u < 0 || v < 0 || u >= view->camera.width || v >= view->camera.height ||
                !phases->live[phase_of(u, v)] || share <= 0)
                continue;
            gsize pixel = (gsize)v * (gsize)view->camera.width + (gsize)u;
            float dn = isfinite(intensity[pixel]) ? MAX(intensity[pixel], 0) : 0;
            ret[n++] = (struct near){view->pixel_mm[pixel], dn, share};
        }
    return n;
}

/* How much of the neighbourhood agrees with one of its pixels; and the mean of what does. */
static float find_support(const MdfView *view, const struct near *near, int n, int of,
                          struct near *ret) {
    *ret = (struct near){0};
    for (int k = 0; k < n; k++)
        if (near[k].mm >= 0 && fabsf(near[k].mm - near[of].mm) <= view->agreement_mm) {
            ret->mm += near[k].share * near[k].mm;
            ret->dn += near[k].share * near[k].dn;
            ret->share += near[k].share;
        }
    ret->mm /= ret->share;
    ret->dn /= ret->share;
    return ret->share;
}

/* Pixels on both sides of a depth edge show two surfaces: the texel is on that of which more is
 * around it, and the mean is taken of that side alone. Where too few have seen the laser, the texel
 * may show what they do not. */
static struct near resample(const MdfView *view, const struct near *near, int n) {
    struct near best = {.mm = -1}, side;
    float all = 0, seen = 0;
    for (int k = 0; k < n; k++) {
        all += near[k].share;
        if (near[k].mm < 0)
            continue;
        seen += near[k].share;
        if (find_support(view, near, n, k, &side) > best.share)
            best = side;
    }
    return seen < SEEN_SHARE * all ? (struct near){.mm = -1} : best;
}

int mdf_view_add(MdfView *view, const struct mdf_sweep *sweep) {
    g_return_val_if_fail(view->n_sweeps < MDF_MAX_SWEEPS, 0);
    gsize n_pixels = (gsize)view->camera.width * (gsize)view->camera.height;
    for (gsize i = 0; i < n_pixels; i++)
        view->pixel_mm[i] = intersect(view, sweep, i);
    struct phases phases = find_phases(view);
    float *texel_mm = view->texel_mm[view->n_sweeps] = g_new(float, view->n_texels);
    float *texel_dn = view->texel_dn[view->n_sweeps] = g_new0(float, view->n_texels);
    view->weight[view->n_sweeps++] =
        mdf_weight(sweep->arc, sweep->laser, sweep->arc_rad, view->centre_mm);
    int seen = 0;
    for (int i = 0; i < view->n_texels; i++) {
        struct near near[16], texel = {.mm = -1};
        if (view->x_px[i] >= 0) {
            int n = find_near(view, &phases, sweep->intensity, view->x_px[i], view->y_px[i], near);
            texel = resample(view, near, n);
        }
        texel_mm[i] = texel.mm;
        texel_dn[i] = texel.dn;
        seen += texel.mm >= 0;
    }
    return seen;
}

struct sample {
    double mm, weight;
};

static int by_mm(const void *a, const void *b) {
    double x = ((const struct sample *)a)->mm, y = ((const struct sample *)b)->mm;
    return (x > y) - (x < y);
}

/* Sorts; of two that share the middle, their mean. */
static double weighted_median(struct sample *samples, int n) {
    qsort(samples, (gsize)n, sizeof *samples, by_mm);
    double total = 0, sum = 0;
    for (int i = 0; i < n; i++)
        total += samples[i].weight;
    for (int i = 0; i < n; i++) {
        sum += samples[i].weight;
        if (sum > 0.5 * total * (1 + 1e-12))
            return samples[i].mm;
        if (sum >= 0.5 * total * (1 - 1e-12) && i + 1 < n)
            return 0.5 * (samples[i].mm + samples[i + 1].mm);
    }
    return samples[n - 1].mm;
}

static double spread_of(const struct sample *samples, int n, double median) {
    struct sample deviation[MDF_MAX_SWEEPS];
    for (int i = 0; i < n; i++)
        deviation[i] = (struct sample){fabs(samples[i].mm - median), samples[i].weight};
    return 1.4826 * weighted_median(deviation, n);
}

/* Interreflections and mixed pixels make outliers; what agrees with the median is averaged (seed
 * 004 §3.2, Merging). */
static void merge_texel(struct sample *samples, int n, int least, float *ret_mm, float *ret_n,
                        float *ret_error) {
    *ret_mm = *ret_error = -1;
    *ret_n = 0;
    if (n == 0)
        return;
    double median = weighted_median(samples, n);
    double limit = MAX(3 * spread_of(samples, n, median), LEAST_AGREEMENT);
    double weights = 0, squares = 0, sum = 0, scatter = 0;
    int kept = 0;
    for (int i = 0; i < n; i++)
        if (fabs(samples[i].mm - median) <= limit) {
            samples[kept++] = samples[i];
            weights += samples[kept - 1].weight;
            squares += samples[kept - 1].weight * samples[kept - 1].weight;
            sum += samples[kept - 1].weight * samples[kept - 1].mm;
        }
    if (kept < least || !(weights > 0))
        return;
    double mean = sum / weights, effective = weights * weights / squares;
    for (int i = 0; i < kept; i++)
        scatter += samples[i].weight * pow(samples[i].mm - mean, 2);
    *ret_mm = (float)mean;
    *ret_n = (float)kept;
    if (kept > 1)
        *ret_error = (float)sqrt(scatter / weights / MAX(effective - 1, 1e-6));
}

/* What each laser position says of a texel. A line that is much fainter than others there grazes
 * the surface, or is not the laser's but its light thrown back by what stands around. */
static int collect(const MdfView *view, int texel, struct sample *ret) {
    float most = 0;
    int n = 0;
    for (int s = 0; s < view->n_sweeps; s++)
        if (view->texel_mm[s][texel] >= 0)
            most = MAX(most, view->texel_dn[s][texel]);
    for (int s = 0; s < view->n_sweeps; s++) {
        if (view->texel_mm[s][texel] < 0 || !(view->weight[s] > 0))
            continue;
        double bright = most > 0 ? view->texel_dn[s][texel] / most : 1;
        double trust = bright * bright / (bright * bright + FAINT * FAINT);
        ret[n++] = (struct sample){view->texel_mm[s][texel], view->weight[s] * trust};
    }
    return n;
}

void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error) {
    struct sample samples[MDF_MAX_SWEEPS];
    int least = view->n_sweeps >= MANY_SWEEPS ? 2 : 1;
    for (int i = 0; i < view->n_texels; i++) {
        int n = collect(view, i, samples);
        merge_texel(samples, n, least, ret_distance + i, ret_n + i, ret_error + i);
    }
}
