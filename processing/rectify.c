#include "rectify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "demosaic.h"
#include "pipeline.h"

#define SPACING_PX  0.25  /* of the points by which a texel is gathered */
#define MOST_EXCESS 10.0f /* of a colour, over what the others would have it */
#define MARKED      0.02f /* of a texel, that a pixel is whose mark it gets */

/* Red, green, blue and nothing. */
typedef float lanes __attribute__((vector_size(16)));

/* Weights over pixels, of each texel. */
struct rows {
    guint32 *start; /* n_texels + 1: into the two below */
    GArray *pixel;  /* guint32 */
    GArray *weight; /* float */
};

struct Rectify {
    int n_texels, n_outside;
    int width, height; /* of the mosaic */
    gsize n_pixels;
    guint8 *colour; /* of each pixel, as in demosaic.h */
    gboolean mono;
    struct rows area;   /* by what each pixel is part of it, times its gain */
    struct rows around; /* smoothly, for a texel's colour */
    float colour_gain[3];
    lanes *ratio; /* of each pixel: factors to red, green and blue; NULL: no guide */
};

struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row) {
    return vec3(grid->width_mm * (column / grid->width - 0.5),
                grid->height_mm * (0.5 - row / grid->height), grid->reference_mm);
}

void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance) {
    for (int row = 0; row < grid->height; row++)
        for (int column = 0; column < grid->width; column++) {
            struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
            *ret_irradiance++ =
                (float)rig_lamp_irradiance(arc, lamp, arc_rad, rig_turn(p, turntable_rad));
        }
}

/* Fills the colour of each pixel; a mono sensor has one, which is called green. */
static gboolean parse_cfa(Rectify *rectify, const char *cfa, int width, GError **error) {
    static const char *const names[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};
    if (!g_strv_contains(names, cfa)) {
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "colour filter \"%s\" is not known; there are mono, rggb, bggr, grbg, gbrg",
                    cfa);
        return FALSE;
    }
    rectify->mono = strcmp(cfa, "mono") == 0;
    rectify->colour = g_new(guint8, rectify->n_pixels);
    for (gsize i = 0; i < rectify->n_pixels; i++) {
        int x = (int)(i % (gsize)width), y = (int)(i / (gsize)width);
        char name = rectify->mono ? 'g' : cfa[2 * (y & 1) + (x & 1)];
        int colour = name == 'r' ? DEMOSAIC_RED : name == 'g' ? DEMOSAIC_GREEN : DEMOSAIC_BLUE;
        rectify->colour[i] = (guint8)colour;
    }
    return TRUE;
}

/* One texel's points in the picture: an even pattern over its area. */
struct footprint {
    double *x, *y;
    int n;
};

static gboolean in_picture(const struct rig_camera *camera, double x, double y) {
    return x >= 0 && y >= 0 && x <= camera->width - 1 && y <= camera->height - 1;
}

static gboolean project_texel(const struct rig_camera *camera, double turntable_rad,
                              const struct session_grid *grid, int column, int row, int side,
                              struct footprint *ret) {
    ret->n = 0;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            struct vec3 p =
                rectify_point_mm(grid, column + (i + 0.5) / side, row + (j + 0.5) / side);
            double *x = &ret->x[ret->n], *y = &ret->y[ret->n++];
            if (!rig_project(camera, rig_turn(p, turntable_rad), x, y) ||
                !in_picture(camera, *x, *y))
                return FALSE;
        }
    return TRUE;
}

/* Weights of pixels, gathered: a dense picture and a list of those that were touched. */
struct weights {
    float *sum;
    gboolean *touched;
    GArray *pixels; /* guint32 */
};

static struct weights new_weights(gsize n_pixels) {
    return (struct weights){g_new0(float, n_pixels), g_new0(gboolean, n_pixels),
                            g_array_new(FALSE, FALSE, sizeof(guint32))};
}

static void free_weights(struct weights *weights) {
    g_free(weights->sum);
    g_free(weights->touched);
    g_array_unref(weights->pixels);
}

static void add_weight(struct weights *weights, guint32 pixel, float weight) {
    if (!weights->touched[pixel])
        g_array_append_val(weights->pixels, pixel);
    weights->touched[pixel] = TRUE;
    weights->sum[pixel] += weight;
}

static void clear_weights(struct weights *weights) {
    for (guint i = 0; i < weights->pixels->len; i++) {
        guint32 pixel = g_array_index(weights->pixels, guint32, i);
        weights->sum[pixel] = 0;
        weights->touched[pixel] = FALSE;
    }
    g_array_set_size(weights->pixels, 0);
}

/* Beyond its border a picture is mirrored at the outermost pixels, which keeps colours in place. */
static int mirror(int i, int n) {
    i = abs(i);
    return i < n ? i : MAX(2 * (n - 1) - i, 0);
}

static guint32 pixel_at(const Rectify *rectify, int x, int y) {
    return (guint32)(mirror(y, rectify->height) * rectify->width + mirror(x, rectify->width));
}

/* A pixel is the mean over its area: of three side by side, the parabola with those means, which is
 * the derivative of Keys' cubic (1981, a = −½) through the sums up to the pixels' borders. What is
 * gathered over whole pixels is therefore theirs exactly. */
static void area_weights(double t, float *ret) {
    ret[0] = (float)((1.5 * t - 2) * t + 0.5);
    ret[1] = (float)((3 - 3 * t) * t + 0.5);
    ret[2] = (float)((1.5 * t - 1) * t);
}

static void weigh_pixels(const Rectify *rectify, const struct footprint *footprint,
                         struct weights *weights) {
    float share = 1.0f / (float)footprint->n, columns[3], rows[3];
    for (int k = 0; k < footprint->n; k++) {
        double x = footprint->x[k] + 0.5, y = footprint->y[k] + 0.5;
        int i = (int)floor(x), j = (int)floor(y);
        area_weights(x - i, columns);
        area_weights(y - j, rows);
        for (int c = 0; c < 9; c++)
            add_weight(weights, pixel_at(rectify, i + c % 3 - 1, j + c / 3 - 1),
                       share * columns[c % 3] * rows[c / 3]);
    }
}

/* Quadratic B-spline over twice the pixels' distance: its sums over one colour's pixels, which are
 * two apart, are the same wherever it stands. */
static float spline(double t) {
    t = fabs(t) / 2;
    return (float)(t < 0.5 ? 0.75 - t * t : t < 1.5 ? 0.5 * (1.5 - t) * (1.5 - t) : 0);
}

static void weigh_around(const Rectify *rectify, const struct footprint *footprint,
                         struct weights *weights) {
    for (int k = 0; k < footprint->n; k++) {
        int i0 = (int)floor(footprint->x[k]) - 2, j0 = (int)floor(footprint->y[k]) - 2;
        float columns[6], rows[6];
        for (int c = 0; c < 6; c++) {
            columns[c] = spline(footprint->x[k] - (i0 + c));
            rows[c] = spline(footprint->y[k] - (j0 + c));
        }
        for (int c = 0; c < 36; c++)
            add_weight(weights, pixel_at(rectify, i0 + c % 6, j0 + c / 6),
                       columns[c % 6] * rows[c / 6]);
    }
}

static struct rows new_rows(int n) {
    return (struct rows){g_new0(guint32, (gsize)n + 1), g_array_new(FALSE, FALSE, sizeof(guint32)),
                         g_array_new(FALSE, FALSE, sizeof(float))};
}

static void clear_rows(struct rows *rows) {
    g_free(rows->start);
    g_clear_pointer(&rows->pixel, g_array_unref);
    g_clear_pointer(&rows->weight, g_array_unref);
}

/* Moves the weights there. */
static void append_row(struct rows *rows, int texel, struct weights *weights, const float *gain) {
    for (guint i = 0; i < weights->pixels->len; i++) {
        guint32 pixel = g_array_index(weights->pixels, guint32, i);
        float weight = weights->sum[pixel] * (gain ? gain[pixel] : 1);
        if (weight == 0)
            continue;
        g_array_append_val(rows->pixel, pixel);
        g_array_append_val(rows->weight, weight);
    }
    rows->start[texel + 1] = rows->pixel->len;
    clear_weights(weights);
}

/* What a pixel's value is multiplied with to be a radiance: DN a millisecond → DN a second, then
 * response and flat field. Its colour is taken out of the texels, since every pixel counts for
 * every colour. */
static float *pixel_gains(const struct rig_camera *camera,
                          const struct radiometry_camera *radiometry) {
    float *gain = g_new(float, (gsize)camera->width *(gsize)camera->height);
    for (int y = 0, i = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++, i++)
            gain[i] =
                (float)(1000 / (camera->response * radiometry_flat(camera, radiometry, x, y)));
    return gain;
}

static void set_colour_gains(Rectify *rectify, const struct radiometry_camera *radiometry) {
    gboolean known = radiometry && radiometry->known;
    for (int c = 0; c < 3; c++)
        rectify->colour_gain[c] =
            known ? (float)(1 / radiometry->colour[rectify->mono ? DEMOSAIC_GREEN : c]) : 1;
}

/* Points a texel and direction, at most that far apart. */
static int points_aside(const struct rig_camera *camera, double turntable_rad,
                        const struct session_grid *grid, double spacing_px) {
    double most = 0;
    for (int k = 0; k < 4; k++) { /* distances grow and shrink smoothly: the corners tell */
        double column = k & 1 ? grid->width - 1 : 0, row = k >> 1 ? grid->height - 1 : 0;
        double x[3], y[3];
        for (int c = 0; c < 3; c++) {
            struct vec3 p = rectify_point_mm(grid, column + (c == 1), row + (c == 2));
            if (!rig_project(camera, rig_turn(p, turntable_rad), &x[c], &y[c]))
                return 4;
        }
        most = MAX(most, MAX(hypot(x[1] - x[0], y[1] - y[0]), hypot(x[2] - x[0], y[2] - y[0])));
    }
    return (int)CLAMP(ceil(most / spacing_px), 2, 64);
}

static gboolean check_outside(const Rectify *rectify, const struct rig_camera *camera,
                              double turntable_rad, GError **error) {
    if (rectify->n_outside * 100.0 <= rectify->n_texels)
        return TRUE;
    g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                "camera %s at turntable %.6g°: %d of %d texels lie outside of its %d × %d pixels; "
                "point it at the sample and calibrate it, or make [sample] smaller in the session",
                camera->name, turntable_rad * 180 / G_PI, rectify->n_outside, rectify->n_texels,
                camera->width, camera->height);
    return FALSE;
}

static void fill_rows(Rectify *rectify, const struct rig_camera *camera,
                      const struct radiometry_camera *radiometry, double turntable_rad,
                      const struct session_grid *grid) {
    int side = points_aside(camera, turntable_rad, grid, SPACING_PX);
    int coarse = points_aside(camera, turntable_rad, grid, 4 * SPACING_PX);
    g_autofree double *x = g_new(double, side *side), *y = g_new(double, side *side);
    g_autofree float *gain = pixel_gains(camera, radiometry);
    struct footprint footprint = {x, y, 0};
    struct weights weights = new_weights(rectify->n_pixels);
    for (int i = 0; i < rectify->n_texels; i++) {
        int column = i % grid->width, row = i / grid->width;
        gboolean inside = project_texel(camera, turntable_rad, grid, column, row, side, &footprint);
        rectify->n_outside += !inside;
        if (inside)
            weigh_pixels(rectify, &footprint, &weights);
        append_row(&rectify->area, i, &weights, gain);
        if (inside && !rectify->mono &&
            project_texel(camera, turntable_rad, grid, column, row, coarse, &footprint))
            weigh_around(rectify, &footprint, &weights);
        append_row(&rectify->around, i, &weights, NULL);
    }
    free_weights(&weights);
}

Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error) {
    g_autoptr(Rectify) rectify = g_new0(Rectify, 1);
    rectify->n_texels = grid->width * grid->height;
    rectify->width = camera->width;
    rectify->height = camera->height;
    rectify->n_pixels = (gsize)camera->width * (gsize)camera->height;
    rectify->area = new_rows(rectify->n_texels);
    rectify->around = new_rows(rectify->n_texels);
    if (!parse_cfa(rectify, cfa, camera->width, error)) {
        g_prefix_error(error, "camera %s: ", camera->name);
        return NULL;
    }
    set_colour_gains(rectify, radiometry);
    fill_rows(rectify, camera, radiometry, turntable_rad, grid);
    if (!check_outside(rectify, camera, turntable_rad, error))
        return NULL;
    return g_steal_pointer(&rectify);
}

void rectify_free(Rectify *rectify) {
    if (!rectify)
        return;
    g_free(rectify->colour);
    g_free(rectify->ratio);
    clear_rows(&rectify->area);
    clear_rows(&rectify->around);
    g_free(rectify);
}

int rectify_outside(const Rectify *rectify) {
    return rectify->n_outside;
}

static lanes *find_ratios(const Rectify *rectify, const float *mosaic) {
    lanes *ratio = g_new(lanes, rectify->n_pixels);
    g_autofree float *found = NULL;
    if (!rectify->mono) {
        found = g_new0(float, 3 * rectify->n_pixels);
        demosaic_ratios(mosaic, rectify->colour, rectify->width, rectify->height, found);
    }
    for (gsize i = 0; i < rectify->n_pixels; i++)
        ratio[i] = found ? (lanes){found[3 * i], found[3 * i + 1], found[3 * i + 2], 0}
                         : (lanes){1, 1, 1, 0};
    return ratio;
}

void rectify_guide(Rectify *rectify, const float *mosaic) {
    g_free(rectify->ratio);
    rectify->ratio = find_ratios(rectify, mosaic);
}

/* Sums over a row for each colour, from its own pixels and from those of the other two; and of the
 * weights of both. */
struct tally {
    lanes own, others, own_weight, others_weight;
};

static void add_up(const Rectify *rectify, const struct rows *rows, int texel, const float *mosaic,
                   const lanes *ratio, struct tally *ret) {
    static const lanes mine[] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    const guint32 *pixel = (const guint32 *)(void *)rows->pixel->data;
    const float *weight = (const float *)(void *)rows->weight->data;
    lanes all = {0}, own = {0}, own_weight = {0}, weights = {0};
    for (guint32 k = rows->start[texel]; k < rows->start[texel + 1]; k++) {
        float value = weight[k] * mosaic[pixel[k]];
        lanes is_mine = mine[rectify->colour[pixel[k]]];
        all += value * ratio[pixel[k]];
        own += value * is_mine;
        own_weight += weight[k] * is_mine;
        weights += weight[k];
    }
    *ret = (struct tally){own, all - own, own_weight, weights - own_weight};
}

/* How much more of a colour its own pixels around a texel see than the others would have it: gloss
 * is as white on blue cloth as on red, and what a red wall lights up is redder than under a lamp.
 */
static float excess(const struct tally *around, int colour) {
    float own_weight = around->own_weight[colour], others_weight = around->others_weight[colour];
    if (!(own_weight > 0) || !(others_weight > 0))
        return 1;
    float own = around->own[colour] / own_weight, others = around->others[colour] / others_weight;
    return others > 0 ? CLAMP(own / others, 1 / MOST_EXCESS, MOST_EXCESS) : 1;
}

static gboolean apply_texel(const Rectify *rectify, int texel, const float *mosaic,
                            const lanes *ratio, float *ret_rgb) {
    struct tally area, around;
    add_up(rectify, &rectify->area, texel, mosaic, ratio, &area);
    add_up(rectify, &rectify->around, texel, mosaic, ratio, &around);
    gboolean seen = rectify->area.start[texel + 1] > rectify->area.start[texel];
    for (int c = 0; c < 3; c++) {
        ret_rgb[c] = rectify->colour_gain[c] * (area.own[c] + area.others[c] * excess(&around, c));
        seen = seen && isfinite(ret_rgb[c]);
    }
    for (int c = 0; c < 3 && !seen; c++)
        ret_rgb[c] = 0;
    return seen;
}

int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes) {
    g_autofree lanes *found = NULL;
    const lanes *ratio = rectify->ratio;
    if (!ratio) {
        found = find_ratios(rectify, mosaic);
        ratio = found;
    }
    int holes = 0;
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        gboolean seen = apply_texel(rectify, texel, mosaic, ratio, ret_rgb + 3 * (gsize)texel);
        holes += !seen;
        if (ret_holes)
            ret_holes[texel] = !seen;
    }
    return holes;
}

static guint8 mark_of(const struct rows *rows, int texel, const guint8 *pixels) {
    const guint32 *pixel = (const guint32 *)(void *)rows->pixel->data;
    const float *weight = (const float *)(void *)rows->weight->data;
    float sum = 0;
    guint8 mark = 0;
    for (guint32 k = rows->start[texel]; k < rows->start[texel + 1]; k++)
        sum += weight[k];
    for (guint32 k = rows->start[texel]; k < rows->start[texel + 1]; k++)
        if (pixels[pixel[k]] && fabsf(weight[k]) >= MARKED * sum)
            mark |= pixels[pixel[k]];
    return mark;
}

void rectify_marks(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels) {
    for (int texel = 0; texel < rectify->n_texels; texel++)
        ret_texels[texel] = mark_of(&rectify->area, texel, pixels);
}
