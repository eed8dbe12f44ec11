#include "rectify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "pipeline.h"

enum { RED, GREEN, BLUE, COLOURS };

/* What is summed for each texel. Green has half of the pixels and is the sharpest colour. Red and
 * blue are interpolated between their own few pixels, and so is green as it would be if it were
 * known at those alone; how much sharper green really is tells how much sharper the others are. */
enum row { ROW_GREEN, ROW_RED, ROW_GREEN_AT_RED, ROW_BLUE, ROW_GREEN_AT_BLUE, ROWS };

#define DARK  0.02f /* of a picture's mean: too dark to tell a colour */
#define TRUST 0.7f  /* in what is sharp in green being so in red and blue; measured on weaves */

struct Rectify {
    int n_texels, n_outside;
    int width, height; /* of the mosaic */
    gsize n_pixels;
    float unit;     /* radiance of one DN a millisecond */
    guint8 *colour; /* of each pixel */
    gboolean mono;
    int first_x[COLOURS], first_y[COLOURS]; /* of red and blue pixels, which are two apart */
    guint32 *start;                         /* n_texels × ROWS + 1: into the two below */
    GArray *pixel;                          /* guint32 */
    GArray *weight;                         /* float */
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
        int colour = name == 'r' ? RED : name == 'g' ? GREEN : BLUE;
        rectify->colour[i] = (guint8)colour;
        rectify->first_x[colour] = x & 1;
        rectify->first_y[colour] = y & 1;
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

/* Keys (1981), a = −½: sharper than linear, and exact for parabolas. */
static void cubic_weights(double t, float *ret) {
    ret[0] = (float)(((-0.5 * t + 1) * t - 0.5) * t);
    ret[1] = (float)((1.5 * t - 2.5) * t * t + 1);
    ret[2] = (float)(((-1.5 * t + 2) * t + 0.5) * t);
    ret[3] = (float)((0.5 * t - 0.5) * t * t);
}

/* Interpolated between pixels x0 + step·i, y0 + step·j, averaged over a texel. */
static void weigh_pixels(const Rectify *rectify, const struct footprint *footprint, int x0, int y0,
                         int step, struct weights *weights) {
    float share = 1.0f / (float)footprint->n, columns[4], rows[4];
    for (int k = 0; k < footprint->n; k++) {
        double x = (footprint->x[k] - x0) / step, y = (footprint->y[k] - y0) / step;
        int i = (int)floor(x), j = (int)floor(y);
        cubic_weights(x - i, columns);
        cubic_weights(y - j, rows);
        for (int c = 0; c < 16; c++)
            add_weight(weights,
                       pixel_at(rectify, x0 + (i + c % 4 - 1) * step, y0 + (j + c / 4 - 1) * step),
                       share * columns[c % 4] * rows[c / 4]);
    }
}

/* Green where the filter is red or blue, in eighths: bilinear, corrected by the Laplacian of the
 * pixel's own colour (Malvar, He and Cutler 2004). */
static const struct {
    int x, y, eighths;
} green_at_other[] = {{0, 0, 4},   {-1, 0, 2}, {1, 0, 2},   {0, -1, 2}, {0, 1, 2},
                      {-2, 0, -1}, {2, 0, -1}, {0, -2, -1}, {0, 2, -1}};

static void to_green(const Rectify *rectify, const struct weights *from, struct weights *to) {
    for (guint i = 0; i < from->pixels->len; i++) {
        guint32 pixel = g_array_index(from->pixels, guint32, i);
        int x = (int)pixel % rectify->width, y = (int)pixel / rectify->width;
        if (rectify->colour[pixel] == GREEN) {
            add_weight(to, pixel, from->sum[pixel]);
            continue;
        }
        for (guint k = 0; k < G_N_ELEMENTS(green_at_other); k++)
            add_weight(to, pixel_at(rectify, x + green_at_other[k].x, y + green_at_other[k].y),
                       from->sum[pixel] * (float)green_at_other[k].eighths / 8);
    }
}

static void append_row(Rectify *rectify, const struct weights *weights, const float *gain) {
    for (guint i = 0; i < weights->pixels->len; i++) {
        guint32 pixel = g_array_index(weights->pixels, guint32, i);
        float weight = weights->sum[pixel] * gain[pixel];
        if (weight == 0)
            continue;
        g_array_append_val(rectify->pixel, pixel);
        g_array_append_val(rectify->weight, weight);
    }
}

/* A texel's rows; the ends of each go to ends. */
static void add_texel(Rectify *rectify, const struct footprint *footprint, const float *gain,
                      struct weights *own, struct weights *green, guint32 *ends) {
    weigh_pixels(rectify, footprint, 0, 0, 1, own);
    to_green(rectify, own, green);
    append_row(rectify, green, gain);
    ends[ROW_GREEN] = rectify->pixel->len;
    clear_weights(own);
    clear_weights(green);
    for (int colour = RED; colour <= BLUE; colour += BLUE - RED) {
        int row = colour == RED ? ROW_RED : ROW_BLUE;
        if (!rectify->mono) {
            weigh_pixels(rectify, footprint, rectify->first_x[colour], rectify->first_y[colour], 2,
                         own);
            to_green(rectify, own, green);
        }
        append_row(rectify, own, gain);
        ends[row] = rectify->pixel->len;
        append_row(rectify, green, gain);
        ends[row + 1] = rectify->pixel->len;
        clear_weights(own);
        clear_weights(green);
    }
}

/* What a pixel's value is multiplied with to be a radiance: DN a millisecond → DN a second, then
 * response and vignetting. */
static float *pixel_gains(const struct rig_camera *camera) {
    float *gain = g_new(float, (gsize)camera->width * camera->height);
    double w = camera->width - 1, h = camera->height - 1, corner2 = 0.25 * (w * w + h * h);
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            double dx = x - camera->cx_px, dy = y - camera->cy_px;
            double light = 1 - camera->vignetting * (dx * dx + dy * dy) / corner2;
            gain[y * camera->width + x] = (float)(1000 / (camera->response * MAX(light, 0.05)));
        }
    return gain;
}

/* Points a texel and direction, so that they lie at most half a pixel apart. */
static int points_aside(const struct rig_camera *camera, double turntable_rad,
                        const struct session_grid *grid) {
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
    return (int)CLAMP(ceil(most / 0.5), 2, 32);
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

static void fill_rows(Rectify *rectify, const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid) {
    int side = points_aside(camera, turntable_rad, grid);
    g_autofree double *x = g_new(double, side *side), *y = g_new(double, side *side);
    g_autofree float *gain = pixel_gains(camera);
    struct footprint footprint = {x, y, 0};
    struct weights own = new_weights(rectify->n_pixels);
    struct weights green = new_weights(rectify->n_pixels);
    for (int i = 0; i < rectify->n_texels; i++) {
        guint32 *ends = rectify->start + (gsize)i * ROWS + 1;
        gboolean inside = project_texel(camera, turntable_rad, grid, i % grid->width,
                                        i / grid->width, side, &footprint);
        rectify->n_outside += !inside;
        for (int row = 0; row < ROWS; row++)
            ends[row] = rectify->pixel->len;
        if (inside)
            add_texel(rectify, &footprint, gain, &own, &green, ends);
    }
    free_weights(&own);
    free_weights(&green);
}

Rectify *rectify_new(const struct rig_camera *camera, const char *cfa, double turntable_rad,
                     const struct session_grid *grid, GError **error) {
    g_autoptr(Rectify) rectify = g_new0(Rectify, 1);
    rectify->n_texels = grid->width * grid->height;
    rectify->width = camera->width;
    rectify->height = camera->height;
    rectify->unit = (float)(1000 / camera->response);
    rectify->n_pixels = (gsize)camera->width * (gsize)camera->height;
    rectify->start = g_new0(guint32, (gsize)rectify->n_texels * ROWS + 1);
    rectify->pixel = g_array_new(FALSE, FALSE, sizeof(guint32));
    rectify->weight = g_array_new(FALSE, FALSE, sizeof(float));
    if (!parse_cfa(rectify, cfa, camera->width, error)) {
        g_prefix_error(error, "camera %s: ", camera->name);
        return NULL;
    }
    fill_rows(rectify, camera, turntable_rad, grid);
    if (!check_outside(rectify, camera, turntable_rad, error))
        return NULL;
    return g_steal_pointer(&rectify);
}

void rectify_free(Rectify *rectify) {
    if (!rectify)
        return;
    g_free(rectify->colour);
    g_free(rectify->start);
    g_clear_pointer(&rectify->pixel, g_array_unref);
    g_clear_pointer(&rectify->weight, g_array_unref);
    g_free(rectify);
}

int rectify_outside(const Rectify *rectify) {
    return rectify->n_outside;
}

/* The mean of each colour, by which they are brought to one scale. */
static void mean_colours(const Rectify *rectify, const float *mosaic, float *ret) {
    double sum[COLOURS] = {0};
    gsize n[COLOURS] = {0};
    for (gsize i = 0; i < rectify->n_pixels; i++)
        if (isfinite(mosaic[i])) {
            sum[rectify->colour[i]] += mosaic[i];
            n[rectify->colour[i]]++;
        }
    for (int c = 0; c < COLOURS; c++)
        ret[c] = n[c] > 0 && sum[c] > 0 ? (float)(sum[c] / (double)n[c]) : 1;
}

/* own + k·(sharp − blurred), where k is own/blurred, or 1 (colours are to one scale) where it is
 * too dark to tell. Pictures linear in x and y are not changed: sharp is blurred. */
static float sharpen(float own, float sharp, float blurred, float dark) {
    float k = (own * blurred + dark * dark) / (blurred * blurred + dark * dark);
    return own + TRUST * CLAMP(k, 0.0f, 8.0f) * (sharp - blurred);
}

int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb) {
    const guint32 *pixel = (const guint32 *)(void *)rectify->pixel->data;
    const float *weight = (const float *)(void *)rectify->weight->data;
    float mean[COLOURS];
    mean_colours(rectify, mosaic, mean);
    g_autofree float *scaled = g_new(float, rectify->n_pixels);
    for (gsize i = 0; i < rectify->n_pixels; i++)
        scaled[i] = mosaic[i] / mean[rectify->colour[i]];
    int holes = 0;
    for (int texel = 0; texel < rectify->n_texels; texel++, ret_rgb += COLOURS) {
        const guint32 *start = rectify->start + (gsize)texel * ROWS;
        float sum[ROWS] = {0};
        for (int row = 0; row < ROWS; row++)
            for (guint32 k = start[row]; k < start[row + 1]; k++)
                sum[row] += weight[k] * scaled[pixel[k]];
        float green = sum[ROW_GREEN], dark = DARK * rectify->unit;
        float red = sharpen(sum[ROW_RED], green, sum[ROW_GREEN_AT_RED], dark);
        float blue = sharpen(sum[ROW_BLUE], green, sum[ROW_GREEN_AT_BLUE], dark);
        gboolean hole =
            start[0] == start[ROWS] || !isfinite(red) || !isfinite(green) || !isfinite(blue);
        ret_rgb[RED] = hole ? 0 : rectify->mono ? green * mean[GREEN] : red * mean[RED];
        ret_rgb[GREEN] = hole ? 0 : green * mean[GREEN];
        ret_rgb[BLUE] = hole ? 0 : rectify->mono ? green * mean[GREEN] : blue * mean[BLUE];
        holes += hole;
    }
    return holes;
}
