/* Measures shadows in the plane of the plate. Each pixel has a position on the plate (struct
 * plate_map) and a value I. The value relative to the lit plate is I / (E cos θ · pattern · level),
 * where E cos θ is the lamp's irradiance on the plate, `pattern` is the print of the plate, and
 * `level` is the level of the lit plate in the picture. */
#include "shadows_private.h"

#include "geometry/fit.h"

#include <math.h>
#include <string.h>

#define LIT 0.8 /* share of the maximum from which a pixel counts as lit */
/* A pixel whose maximum over the pictures is below this share of the plate's level has no
 * pattern. */
#define PATTERN      0.5
#define MIN_CONTRAST 0.35 /* smallest contrast of a shadow, relative to the lit level */
#define MAX_RESIDUAL 0.12 /* largest RMS residual of the shape, relative to the lit level */
#define MIN_PIXELS   30
#define MAX_HIDDEN   0.35 /* largest share of hidden pixels around the shadow's end */
/* smallest cosine of the zenith angle of a lamp with which posts themselves are measured */
#define BODY_LAMP 0.7
#define FLOOR_PX  0.01 /* model error of the shape, added to each sight's error */

/* Intersects each pixel's ray e + t r with the plate: t = (z_plate − e_z) / r_z. */
struct plate_map *plate_map_new(const struct rig_camera *camera, const struct lamp_target *target) {
    struct plate_map *map = g_new(struct plate_map, 1);
    struct vec3 eye = rig_camera_centre_mm(camera);
    double reach = hypot(target->plate_mm[0], target->plate_mm[1]) / 2;
    float *xy = g_new(float, 2 * (gsize)camera->width * (gsize)camera->height);
    *map = (struct plate_map){camera->width, camera->height, xy};
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++, xy += 2) {
            struct vec3 ray = rig_pixel_ray(camera, x, y);
            double t = ray.z < 0 ? (target->plane_mm - eye.z) / ray.z : NAN;
            xy[0] = (float)(eye.x + t * ray.x);
            xy[1] = (float)(eye.y + t * ray.y);
            if (!(hypot((double)xy[0], (double)xy[1]) <= reach))
                xy[0] = xy[1] = NAN;
        }
    return map;
}

void plate_map_free(struct plate_map *map) {
    if (!map)
        return;
    g_free(map->xy_mm);
    g_free(map);
}

static void clear_shot(gpointer data) {
    struct shot *shot = data;
    g_free(shot->name);
    g_free(shot->values);
}

ShadowView *shadow_view_new(const struct rig *rig, int camera, double turntable_rad,
                            const struct lamp_target *target, const struct plate_map *map) {
    ShadowView *view = g_new0(ShadowView, 1);
    view->rig = g_new(struct rig, 1);
    rig_at(rig, turntable_rad, view->rig);
    if (rig_wobble_most_rad(&rig->wobble) > 0)
        view->own_map = plate_map_new(&view->rig->cameras[camera], target);
    view->map = view->own_map ? view->own_map : map;
    view->target = *target;
    view->camera = camera;
    view->turntable_rad = turntable_rad;
    view->shots = g_array_new(FALSE, FALSE, sizeof(struct shot));
    g_array_set_clear_func(view->shots, clear_shot);
    return view;
}

void shadow_view_free(ShadowView *view) {
    if (!view)
        return;
    g_array_unref(view->shots);
    g_free(view->pattern);
    plate_map_free(view->own_map);
    g_free(view->rig);
    g_free(view);
}

/* Returns the median of every seventh value, without those that are not finite. Returns 0 if none
 * is left. */
static double median_of(const float *values, gsize n) {
    g_autofree float *some = g_new(float, n / 7 + 1);
    gsize count = 0;
    for (gsize i = 0; i < n; i += 7)
        if (isfinite(values[i]))
            some[count++] = values[i];
    if (count == 0)
        return 0;
    qsort(some, count, sizeof *some, fit_compare_floats);
    return (double)some[count / 2];
}

/* Returns the picture divided by the lamp's approximate irradiance on the plate, E cos θ. Pixels
 * that do not show the plate are NaN. */
static float *shade(const ShadowView *view, const struct picture *picture, int lamp,
                    double arc_rad) {
    gsize n = (gsize)picture->width * (gsize)picture->height;
    float *values = g_new(float, n);
    const struct rig *rig = view->rig;
    struct vec3 at = rig_lamp_position_mm(&rig->arc, &rig->lamps[lamp], arc_rad);
    for (gsize i = 0; i < n; i++) {
        const float *xy = view->map->xy_mm + 2 * i;
        struct vec3 p = vec3((double)xy[0], (double)xy[1], view->target.plane_mm);
        struct vec3 q = rig_turn(p, -view->turntable_rad);
        values[i] = NAN;
        if (!(fabs(q.x) < view->target.plate_mm[0] / 2 && fabs(q.y) < view->target.plate_mm[1] / 2))
            continue; /* the pixel does not show the plate */
        struct vec3 path = vec3_sub(at, p);
        double light = rig_lamp_irradiance(&rig->arc, &rig->lamps[lamp], arc_rad, p) * path.z /
                       vec3_length(path);
        if (light > 0)
            values[i] = (float)((double)picture->values[i] / light);
    }
    return values;
}

gboolean shadow_view_add(ShadowView *view, const struct picture *picture, int index, int lamp,
                         double arc_rad, GError **error) {
    gsize n = (gsize)picture->width * (gsize)picture->height;
    if (picture->width != view->map->width || picture->height != view->map->height) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s has %d × %d pixels, but camera %s has %d × %d: use pictures of this camera "
                    "that are neither cropped nor scaled",
                    picture->name, picture->width, picture->height,
                    view->rig->cameras[view->camera].name, view->map->width, view->map->height);
        return FALSE;
    }
    g_autofree float *values = shade(view, picture, lamp, arc_rad);
    double level = median_of(values, n);
    if (!(level > 0)) {
        gsize shown = 0; /* number of pixels that show the plate */
        for (gsize i = 0; i < n; i++)
            shown += isfinite(values[i]);
        if (shown > 0)
            g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                        "%s: the plate is dark; check that lamp %s is lit, and the exposure",
                        picture->name, view->rig->lamps[lamp].name);
        else
            g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                        "%s: by the calibration and the target's description, camera %s does not "
                        "see the plate, or lamp %s does not light it; correct the description, or "
                        "give a calibration with the right positions of camera and lamp with -c",
                        picture->name, view->rig->cameras[view->camera].name,
                        view->rig->lamps[lamp].name);
        return FALSE;
    }
    for (gsize i = 0; i < n; i++)
        values[i] = (float)((double)values[i] / level);
    struct shot shot = {index, lamp, arc_rad, g_strdup(picture->name), g_steal_pointer(&values)};
    g_array_append_val(view->shots, shot);
    return TRUE;
}

/* Computes the plate's own pattern: for each pixel, sum and number of the pictures in which it is
 * lit. With fewer than three pictures, no pattern is computed. */
void shadow_find_pattern(ShadowView *view) {
    gsize n = (gsize)view->map->width * (gsize)view->map->height;
    if (view->pattern || view->shots->len < 3)
        return;
    view->pattern = g_new0(struct pattern, n);
    for (gsize i = 0; i < n; i++) {
        struct pattern *to = &view->pattern[i];
        float most = 0;
        for (guint k = 0; k < view->shots->len; k++)
            most = fmaxf(most, g_array_index(view->shots, struct shot, k).values[i]);
        to->least = most > (float)PATTERN ? (float)LIT * most : G_MAXFLOAT;
        for (guint k = 0; k < view->shots->len; k++) {
            float value = g_array_index(view->shots, struct shot, k).values[i];
            if (value >= to->least) {
                to->sum += value;
                to->n++;
            }
        }
    }
}

/* Returns the value divided by the mean of the other pictures in which the pixel is lit. If this
 * picture were included, the rims of its shadows would become part of the pattern, and the shadows
 * would become smaller. If shadows cover the pixel in all other pictures, the pattern is unknown
 * and taken as 1. */
double shadow_value(const ShadowView *view, const struct shot *shot, gsize pixel) {
    const double value = (double)shot->values[pixel];
    if (!view->pattern)
        return value;
    const struct pattern *of = &view->pattern[pixel];
    const gboolean own = value >= (double)of->least;
    const int others = of->n - own;
    return of->n >= 2 && others > 0 ? value * others / ((double)of->sum - (own ? value : 0))
                                    : value;
}

/* Computes central differences of the plate position along column and row, and the size of a pixel
 * from them. Returns FALSE at the border of the picture or of the plate. */
static gboolean set_slope(struct window *w, int column, int row) {
    const struct plate_map *map = w->view->map;
    if (column < 1 || row < 1 || column >= map->width - 1 || row >= map->height - 1)
        return FALSE;
    const float *at = map->xy_mm + 2 * ((gsize)row * (gsize)map->width + (gsize)column);
    const float *right = at + 2, *left = at - 2, *down = at + 2 * map->width,
                *up = at - 2 * map->width;
    for (int k = 0; k < 2; k++) {
        w->slope[2 * k] = ((double)right[k] - (double)left[k]) / 2;
        w->slope[2 * k + 1] = ((double)down[k] - (double)up[k]) / 2;
    }
    const double *s = w->slope;
    w->pixel_mm = sqrt((s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3]) / 2);
    w->long_mm = MAX(hypot(w->slope[0], w->slope[2]), hypot(w->slope[1], w->slope[3]));
    return isfinite(w->pixel_mm);
}

/* Takes a pixel if it is within reach_mm of the shadow's end, and if it shows only plate and
 * shadow. */
static void take_pixel(struct window *w, gsize i, double reach_mm, double margin_mm) {
    const float *xy = w->view->map->xy_mm + 2 * i;
    struct pixel p = {(double)xy[0], (double)xy[1],
                      w->body ? (double)w->shot->values[i] : shadow_value(w->view, w->shot, i)};
    double away = hypot(p.x - w->streak.to.x, p.y - w->streak.to.y);
    double ax = w->streak.to.x - w->streak.from.x, ay = w->streak.to.y - w->streak.from.y;
    double beyond = (p.x - w->streak.to.x) * ax + (p.y - w->streak.to.y) * ay;
    /* Use only the far half of a post's top. This half is evenly bright, but the side of the post
     * is not. */
    if (!(away < reach_mm) || !isfinite(p.value) || (w->body && !(beyond > 0)))
        return;
    gboolean near_end = away < w->streak.to_mm + w->pixel_mm;
    w->near_end += near_end;
    for (int k = 0; k < w->n_others; k++)
        if (shadow_outside_mm(&w->others[k], p.x, p.y) < margin_mm + w->long_mm) {
            w->hidden += near_end;
            return;
        }
    g_array_append_val(w->pixels, p);
}

/* Collects the pixels around the end of the shadow. Returns FALSE if the end is outside the picture
 * or the plate. That is not an error. */
static gboolean fill_window(struct window *w, double reach_mm, double margin_mm) {
    const ShadowView *view = w->view;
    const struct rig_camera *camera = &view->rig->cameras[view->camera];
    struct vec3 end = rig_turn(w->streak.to, -view->turntable_rad);
    double x, y;
    if (fabs(end.x) + w->streak.to_mm > w->target->plate_mm[0] / 2 ||
        fabs(end.y) + w->streak.to_mm > w->target->plate_mm[1] / 2 ||
        !rig_project(camera, w->streak.to, &x, &y) || !set_slope(w, (int)lround(x), (int)lround(y)))
        return FALSE;
    double det = fabs(w->slope[0] * w->slope[3] - w->slope[1] * w->slope[2]);
    int columns = (int)ceil(reach_mm * hypot(w->slope[1], w->slope[3]) / det) + 1;
    int rows = (int)ceil(reach_mm * hypot(w->slope[0], w->slope[2]) / det) + 1;
    for (int j = (int)lround(y) - rows; j <= (int)lround(y) + rows; j++)
        for (int i = (int)lround(x) - columns; i <= (int)lround(x) + columns; i++)
            if (i >= 0 && j >= 0 && i < camera->width && j < camera->height)
                take_pixel(w, (gsize)j * (gsize)camera->width + (gsize)i, reach_mm, margin_mm);
    return TRUE;
}

/* Fits the shape. On success appends a sight. Otherwise appends the reason to rejected, which may
 * be NULL. */
static void fit_end(struct window *w, GArray *sights, GPtrArray *rejected) {
    gboolean near = w->near;
    struct shape_fit f = {.p = {w->streak.to.x, w->streak.to.y, 1, 0.1, 0.05}};
    const char *why = NULL;
    if (w->hidden > MAX_HIDDEN * w->near_end || w->pixels->len < MIN_PIXELS)
        why = "has a shadow whose end is hidden from the camera or overlaps another shadow";
    else if ((!near && !shadow_fit_shape(w, 0.4 * w->streak.to_mm, &f)) ||
             !shadow_fit_shape(w, 0, &f))
        why = "has no shadow where the shadow should end";
    else if (f.p[2] - f.p[3] < MIN_CONTRAST * f.p[2] ||
             hypot(f.p[0] - w->streak.to.x, f.p[1] - w->streak.to.y) >
                 (near ? 1.0 : 2.5) * w->streak.to_mm)
        why = "has no clear shadow where the shadow should end";
    else if (f.rms > (near ? 1 : 2) * MAX_RESIDUAL * f.p[2])
        why = "has a shadow that is not that of a round post";
    if (why && rejected)
        g_ptr_array_add(rejected,
                        g_strdup_printf("%s: post %d %s", w->shot->name, w->mark + 1, why));
    if (why)
        return;
    struct vec3 at = rig_turn(vec3(f.p[0], f.p[1], 0), -w->view->turntable_rad);
    double floor_mm = FLOOR_PX * w->long_mm;
    struct lamp_sight sight = {
        .picture = w->shot->index,
        .lamp = w->body ? -1 : w->shot->lamp,
        .camera = w->view->camera,
        .mark = w->mark,
        .turntable_rad = w->view->turntable_rad,
        .arc_rad = w->shot->arc_rad,
        .x = at.x,
        .y = at.y,
        .sigma = sqrt((f.variance[0] + f.variance[1]) / 2 + floor_mm * floor_mm),
    };
    g_array_append_val(sights, sight);
}

/* Measures a post's shadow. If body is TRUE, measures the post itself, which is the shadow that a
 * light at the camera would cast. */
static void measure_mark(struct window *w, gboolean body, struct vec3 lamp_mm, struct vec3 eye_mm,
                         GArray *sights, GPtrArray *rejected) {
    g_array_set_size(w->pixels, 0);
    w->hidden = w->near_end = 0;
    w->body = body;
    if (!shadow_streak(w->target, w->mark, w->view->turntable_rad, body ? eye_mm : lamp_mm,
                       &w->streak) ||
        vec3_length(vec3_sub(w->streak.to, w->streak.from)) < w->target->radius_mm)
        return; /* the post's foot covers the shadow */
    /* Collects everything that may overlap the shadow or the post. */
    w->n_others = 0;
    for (int i = 0; i < w->target->n; i++) {
        struct streak *next = &w->others[w->n_others];
        if (!body || i != w->mark)
            w->n_others += shadow_streak(w->target, i, w->view->turntable_rad, eye_mm, next);
        next = &w->others[w->n_others];
        if (body || i != w->mark)
            w->n_others += shadow_streak(w->target, i, w->view->turntable_rad, lamp_mm, next);
    }
    double r = w->streak.to_mm;
    if (fill_window(w, w->near ? 2.5 * r : 3.5 * r, w->near ? 0.15 * r : 0.5 * r))
        fit_end(w, sights, rejected);
}

/* A sight's error, estimated from the residuals of a few pixels, is inaccurate. The variance is
 * therefore averaged with the square of the median error of the view's sights, which begin at
 * `first`. Posts themselves (bodies) and shadows have separate medians. */
static void share_sigmas(GArray *sights, guint first, gboolean bodies) {
    g_autoptr(GArray) sorted = g_array_new(FALSE, FALSE, sizeof(double));
    for (guint i = first; i < sights->len; i++) {
        const struct lamp_sight *s = &g_array_index(sights, struct lamp_sight, i);
        if ((s->lamp < 0) == bodies)
            g_array_append_val(sorted, s->sigma);
    }
    if (sorted->len == 0)
        return;
    g_array_sort(sorted, fit_compare);
    const double usual = g_array_index(sorted, double, sorted->len / 2);
    for (guint i = first; i < sights->len; i++) {
        struct lamp_sight *s = &g_array_index(sights, struct lamp_sight, i);
        if ((s->lamp < 0) == bodies)
            s->sigma = sqrt((s->sigma * s->sigma + usual * usual) / 2);
    }
}

void shadow_view_measure(ShadowView *view, const struct rig *rig, const struct lamp_target *target,
                         gboolean near, GArray *sights, GPtrArray *rejected) {
    shadow_find_pattern(view);
    g_autofree struct rig *at = g_new(struct rig, 1);
    rig_at(rig, view->turntable_rad, at);
    struct vec3 eye = rig_camera_centre_mm(&at->cameras[view->camera]);
    gboolean seen = FALSE;
    const guint first = sights->len;
    for (guint i = 0; i < view->shots->len; i++) {
        const struct shot *shot = &g_array_index(view->shots, struct shot, i);
        /* Under low lamps the side of a post is bright and the plate is dark. The edge of a post
         * covers the same pixels in every picture, so one measurement has all the information. */
        gboolean body = vec3_unit(at->lamps[shot->lamp].position_mm).z > BODY_LAMP && !seen;
        seen |= body;
        struct vec3 lamp = rig_lamp_position_mm(&at->arc, &at->lamps[shot->lamp], shot->arc_rad);
        g_autoptr(GArray) pixels = g_array_new(FALSE, FALSE, sizeof(struct pixel));
        struct window w = {
            .view = view, .shot = shot, .target = target, .pixels = pixels, .near = near};
        for (w.mark = 0; w.mark < target->n; w.mark++) {
            measure_mark(&w, FALSE, lamp, eye, sights, rejected);
            if (body)
                measure_mark(&w, TRUE, lamp, eye, sights, NULL);
        }
    }
    share_sigmas(sights, first, FALSE);
    share_sigmas(sights, first, TRUE);
}
