#include "rectify.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "demosaic.h"

#define SPACING_PX  0.25  /* distance of the points that sample a texel */
#define MOST_EXCESS 10.0f /* bound of the ratio of measured to predicted colour */
#define EDGE_DETAIL 0.05f /* κ² of rectify_structure(); measured: docs/accuracy.md */
#define CHROMA_PX   4.0   /* see rectify_structure(); measured: docs/accuracy.md */
#define FLAG_WEIGHT 0.02f /* share of a texel from which a pixel passes on its flags */

/* Adjacent pixels that one vector instruction sums. */
#define LANES 8
typedef float wide __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* The pixels that a texel has weights for. It begins at an even column, so that a lane has the
 * same colour filter in the window of every texel. */
struct window {
    guint32 start; /* index of its first weight; there are n_rows × n_wide × LANES */
    guint16 x, y, n_rows, n_wide;
};

struct rows {
    struct window *window; /* n_texels */
    GArray *weight;        /* float; 0 outside of the footprint */
};

struct Rectify {
    int n_texels, columns, n_outside; /* columns: of texels */
    int width, height;                /* of the mosaic */
    gsize stride;                     /* of padded rows: windows may reach beyond the border */
    gsize n_pixels;
    guint8 *colour;      /* of each pixel, as in demosaic.h */
    int phase[4];        /* colours of the 2 × 2 filter cell, row by row */
    gboolean mono;       /* all pixels see the same: one colour, or (planes is 3) all three */
    gsize planes;        /* of a frame: 1, or 3 of "rgb" */
    struct rows area;    /* each pixel's share of the texel's area, times its gain */
    struct rows around;  /* smooth weights, for the colour of a texel */
    float (*balance)[3]; /* n_texels: weight of the other colours over that of this one, in around;
                            0: none */
    float colour_gain[3];
    float chroma; /* CHROMA_PX / pixels across a texel, in the direction in which it is shortest */
    float
        *ratio; /* planes of factors to red, green and blue, 0 for a pixel's own; NULL: no guide */
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

/* Sets the colour of each pixel. A mono sensor has one colour, which counts as green; so has each
 * plane of "rgb". */
static gboolean parse_cfa(Rectify *rectify, const char *cfa, int width, GError **error) {
    static const char *const names[] = {"mono", "rggb", "bggr", "grbg", "gbrg", "rgb", NULL};
    if (!g_strv_contains(names, cfa)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "unknown colour filter \"%s\"; known ones are mono, rggb, bggr, grbg, "
                    "gbrg, rgb",
                    cfa);
        return FALSE;
    }
    rectify->planes = strcmp(cfa, "rgb") == 0 ? 3 : 1;
    rectify->mono = strcmp(cfa, "mono") == 0 || rectify->planes == 3;
    rectify->colour = g_new(guint8, rectify->n_pixels);
    for (gsize i = 0; i < rectify->n_pixels; i++) {
        int x = (int)(i % (gsize)width), y = (int)(i / (gsize)width);
        char name = rectify->mono ? 'g' : cfa[2 * (y & 1) + (x & 1)];
        int colour = name == 'r' ? DEMOSAIC_RED : name == 'g' ? DEMOSAIC_GREEN : DEMOSAIC_BLUE;
        rectify->colour[i] = (guint8)colour;
        if (x < 2 && y < 2)
            rectify->phase[2 * y + x] = colour;
    }
    return TRUE;
}

/* Sample points of a texel, projected into the picture: side × side points over its area. */
struct footprint {
    double *x, *y;
    int n;
};

/* FALSE if any point lies outside of the picture. */
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
                !(*x >= 0 && *y >= 0 && *x <= camera->width - 1 && *y <= camera->height - 1))
                return FALSE;
        }
    return TRUE;
}

/* Accumulates weights of pixels: a dense array and the list of the pixels that are not 0. */
struct weights {
    float *sum;
    gboolean *touched;
    GArray *pixels; /* guint32 */
};

static void add_weight(struct weights *weights, guint32 pixel, float weight) {
    if (!weights->touched[pixel])
        g_array_append_val(weights->pixels, pixel);
    weights->touched[pixel] = TRUE;
    weights->sum[pixel] += weight;
}

static guint32 rectify_pixel_at(const Rectify *rectify, int x, int y) {
    return (guint32)(demosaic_mirror(y, rectify->height) * rectify->width +
                     demosaic_mirror(x, rectify->width));
}

/* A pixel is the mean over its area. Of three adjacent pixels, this is the parabola that has
 * their means, evaluated at t in the middle one (0 … 1): the derivative of Keys' cubic (1981, a =
 * −½) through the cumulative sums at the pixel borders. A mean over whole pixels is therefore
 * exact.
 *   w₋₁ = (3t − 4)t/2 + ½,   w₀ = (3 − 3t)t + ½,   w₊₁ = (3t − 2)t/2. */
static void area_weights(double t, float *ret) {
    ret[0] = (float)((1.5 * t - 2) * t + 0.5);
    ret[1] = (float)((3 - 3 * t) * t + 0.5);
    ret[2] = (float)((1.5 * t - 1) * t);
}

/* Weight of pixel p: the mean over the sample points of w(column) · w(row). */
static void weigh_pixels(const Rectify *rectify, const struct footprint *footprint,
                         struct weights *weights) {
    float share = 1.0f / (float)footprint->n, columns[3], rows[3];
    for (int k = 0; k < footprint->n; k++) {
        double x = footprint->x[k] + 0.5, y = footprint->y[k] + 0.5;
        int i = (int)floor(x), j = (int)floor(y);
        area_weights(x - i, columns);
        area_weights(y - j, rows);
        for (int c = 0; c < 9; c++)
            add_weight(weights, rectify_pixel_at(rectify, i + c % 3 - 1, j + c / 3 - 1),
                       share * columns[c % 3] * rows[c / 3]);
    }
}

/* Quadratic B-spline B₂(t/2). Its sum over the pixels of one colour, which are two apart, does
 * not depend on the position (partition of unity). */
static float spline(double t) {
    t = fabs(t) / 2;
    return (float)(t < 0.5 ? 0.75 - t * t : t < 1.5 ? 0.5 * (1.5 - t) * (1.5 - t) : 0);
}

/* Smooth weights around a texel for the estimate of its colour. */
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
            add_weight(weights, rectify_pixel_at(rectify, i0 + c % 6, j0 + c / 6),
                       columns[c % 6] * rows[c / 6]);
    }
}

static struct rows new_rows(int n) {
    return (struct rows){g_new0(struct window, n), g_array_new(FALSE, TRUE, sizeof(float))};
}

static void rectify_clear_rows(struct rows *rows) {
    g_free(rows->window);
    g_clear_pointer(&rows->weight, g_array_unref);
}

static const float *weights_of(const struct rows *rows, int texel) {
    return (const float *)(void *)rows->weight->data + rows->window[texel].start;
}

/* Moves the weights from the accumulator, which is 0 again afterwards, to the row of a texel. Its
 * window is the smallest with all pixels of non-zero weight; n_rows is 0 if there is none. */
static void rectify_append_row(const Rectify *rectify, struct rows *rows, int texel,
                               struct weights *weights, const float *gain) {
    struct window *window = &rows->window[texel];
    guint x0 = G_MAXUINT, x1 = 0, y0 = G_MAXUINT, y1 = 0, width = (guint)rectify->width;
    for (guint i = 0; i < weights->pixels->len; i++) {
        guint32 pixel = g_array_index(weights->pixels, guint32, i);
        if (weights->sum[pixel] == 0)
            continue;
        x0 = MIN(x0, pixel % width & ~1U);
        x1 = MAX(x1, pixel % width);
        y0 = MIN(y0, pixel / width);
        y1 = MAX(y1, pixel / width);
    }
    *window = (struct window){.start = rows->weight->len};
    if (x0 <= x1)
        *window = (struct window){rows->weight->len, (guint16)x0, (guint16)y0,
                                  (guint16)(y1 - y0 + 1), (guint16)((x1 - x0) / LANES + 1)};
    const guint columns = (guint)window->n_wide * LANES;
    g_array_set_size(rows->weight, window->start + window->n_rows * columns);
    float *to = (float *)(void *)rows->weight->data + window->start;
    for (guint i = 0; i < weights->pixels->len; i++) {
        guint32 pixel = g_array_index(weights->pixels, guint32, i);
        guint x = pixel % width - window->x, y = pixel / width - window->y;
        if (weights->sum[pixel] != 0)
            to[y * columns + x] = weights->sum[pixel] * (gain ? gain[pixel] : 1);
        weights->sum[pixel] = 0;
        weights->touched[pixel] = FALSE;
    }
    g_array_set_size(weights->pixels, 0);
}

/* balance_c = Σ_{k≠c} w / Σ_{k=c} w over the texel's smooth weights. */
static void balance(Rectify *rectify, int texel) {
    const struct window *window = &rectify->around.window[texel];
    const float *weight = weights_of(&rectify->around, texel);
    const int columns = window->n_wide * LANES;
    float own[3] = {0}, all = 0;
    for (int i = 0; i < window->n_rows * columns; i++) {
        own[rectify->phase[2 * ((window->y + i / columns) & 1) + (i & 1)]] += weight[i];
        all += weight[i];
    }
    for (int c = 0; c < 3; c++)
        rectify->balance[texel][c] = own[c] > 0 && all - own[c] > 0 ? (all - own[c]) / own[c] : 0;
}

/* Shortest and longest side of a texel in pixels; FALSE if a corner texel is not before the camera.
 * The size varies smoothly over the grid: corners have the extremes. */
static gboolean rectify_sides_px(const struct rig_camera *camera, double turntable_rad,
                                 const struct session_grid *grid, double *ret_shortest,
                                 double *ret_longest) {
    *ret_shortest = INFINITY;
    *ret_longest = 0;
    for (int k = 0; k < 4; k++) {
        double column = k & 1 ? grid->width - 1 : 0, row = k >> 1 ? grid->height - 1 : 0;
        double x[3], y[3];
        for (int c = 0; c < 3; c++) {
            struct vec3 p = rectify_point_mm(grid, column + (c == 1), row + (c == 2));
            if (!rig_project(camera, rig_turn(p, turntable_rad), &x[c], &y[c]))
                return FALSE;
        }
        for (int c = 1; c < 3; c++) {
            const double side = hypot(x[c] - x[0], y[c] - y[0]);
            *ret_shortest = MIN(*ret_shortest, side);
            *ret_longest = MAX(*ret_longest, side);
        }
    }
    return TRUE;
}

/* Sample points per texel and direction so that their distance is at most spacing_px: ⌈longest
 * side of a corner texel / spacing⌉. */
static int points_aside(double longest_px, double spacing_px) {
    return (int)CLAMP(ceil(longest_px / spacing_px), 2, 64);
}

static void fill_rows(Rectify *rectify, const struct rig_camera *camera,
                      const struct radiometry_camera *radiometry, double turntable_rad,
                      const struct session_grid *grid) {
    const gsize n = rectify->n_pixels, width = (gsize)camera->width;
    double shortest, longest;
    const gboolean seen = rectify_sides_px(camera, turntable_rad, grid, &shortest, &longest);
    const int side = seen ? points_aside(longest, SPACING_PX) : 4;
    const int coarse = seen ? points_aside(longest, 4 * SPACING_PX) : 4;
    rectify->chroma = seen && shortest > 0 ? (float)(CHROMA_PX / shortest) : 1;
    g_autofree double *x = g_new(double, side *side), *y = g_new(double, side *side);
    g_autofree float *gain = g_new(float, n), *sum = g_new0(float, n);
    g_autofree gboolean *touched = g_new0(gboolean, n);
    g_autoptr(GArray) pixels = g_array_new(FALSE, FALSE, sizeof(guint32));
    struct footprint footprint = {x, y, 0};
    struct weights weights = {sum, touched, pixels};
    /* From DN per ms to radiance: 1000 / (response · flat field). The gain of a pixel's colour is
     * applied to the texels instead, since every pixel contributes to all colours. */
    for (gsize i = 0; i < n; i++)
        gain[i] =
            (float)(1000 / (camera->response * radiometry_flat(camera, radiometry, (int)(i % width),
                                                               (int)(i / width))));
    for (int i = 0; i < rectify->n_texels; i++) {
        int column = i % grid->width, row = i / grid->width;
        gboolean inside = project_texel(camera, turntable_rad, grid, column, row, side, &footprint);
        rectify->n_outside += !inside;
        if (inside)
            weigh_pixels(rectify, &footprint, &weights);
        rectify_append_row(rectify, &rectify->area, i, &weights, gain);
        if (inside && !rectify->mono &&
            project_texel(camera, turntable_rad, grid, column, row, coarse, &footprint))
            weigh_around(rectify, &footprint, &weights);
        rectify_append_row(rectify, &rectify->around, i, &weights, NULL);
        balance(rectify, i);
    }
}

Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error) {
    g_autoptr(Rectify) rectify = g_new0(Rectify, 1);
    rectify->n_texels = grid->width * grid->height;
    rectify->columns = grid->width;
    rectify->width = camera->width;
    rectify->height = camera->height;
    rectify->n_pixels = (gsize)camera->width * (gsize)camera->height;
    rectify->stride = (gsize)camera->width + LANES;
    rectify->balance = g_malloc0_n((gsize)rectify->n_texels, sizeof *rectify->balance);
    rectify->area = new_rows(rectify->n_texels);
    rectify->around = new_rows(rectify->n_texels);
    if (!parse_cfa(rectify, cfa, camera->width, error)) {
        g_prefix_error(error, "camera %s: ", camera->name);
        return NULL;
    }
    for (int c = 0; c < 3; c++)
        rectify->colour_gain[c] =
            radiometry && radiometry->known
                ? (float)(1 /
                          radiometry
                              ->colour[rectify->mono && rectify->planes == 1 ? DEMOSAIC_GREEN : c])
                : 1;
    fill_rows(rectify, camera, radiometry, turntable_rad, grid);
    if (rectify->n_outside * 100.0 <= rectify->n_texels)
        return g_steal_pointer(&rectify);
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "camera %s at turntable %.6g°: %d of %d texels lie outside of its %d × %d pixels; "
                "point it at the sample and calibrate it, or make [sample] smaller in the session",
                camera->name, turntable_rad * 180 / G_PI, rectify->n_outside, rectify->n_texels,
                camera->width, camera->height);
    return NULL;
}

void rectify_free(Rectify *rectify) {
    if (!rectify)
        return;
    g_free(rectify->colour);
    g_free(rectify->ratio);
    g_free(rectify->balance);
    rectify_clear_rows(&rectify->area);
    rectify_clear_rows(&rectify->around);
    g_free(rectify);
}

int rectify_outside(const Rectify *rectify) {
    return rectify->n_outside;
}

/* Demosaicing factors of a mosaic as three padded planes (height × stride each), 0 for a pixel's
 * own colour, so that own and estimated values are summed separately. */
static float *find_ratios(const Rectify *rectify, const float *mosaic) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    float *ratio = g_new0(float, 3 * plane);
    g_autofree float *found = NULL;
    if (!rectify->mono) {
        found = g_new0(float, 3 * rectify->n_pixels);
        demosaic_ratios(mosaic, rectify->colour, rectify->width, rectify->height, found);
    }
    for (gsize i = 0; i < 3 * rectify->n_pixels; i++) {
        const gsize pixel = i / 3, c = i % 3, width = (gsize)rectify->width;
        if (rectify->colour[pixel] != c)
            ratio[c * plane + pixel / width * rectify->stride + pixel % width] =
                found ? found[i] : 1;
    }
    return ratio;
}

void rectify_guide(Rectify *rectify, const float *mosaic) {
    if (rectify->planes == 3)
        return;
    g_free(rectify->ratio);
    rectify->ratio = find_ratios(rectify, mosaic);
}

/* Weighted sums over a window: of the pixels of each colour, and of the values that the pixels of
 * the other two colours predict for it. */
struct tally {
    float own[3], others[3];
};

static inline float rectify_sum_of(const wide *value) {
    const float *v = (const float *)value;
    return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}

/* own_c = Σ w·m over pixels of colour c, others_c = Σ w·m·ratio_c over the other pixels. mosaic
 * is padded: its rows have the stride of the ratios. */
static inline __attribute__((always_inline)) void add_up(const Rectify *rectify,
                                                         const struct rows *rows, int texel,
                                                         const float *mosaic, const float *ratio,
                                                         struct tally *ret) {
    const struct window *window = &rows->window[texel];
    const gsize plane = rectify->stride * (gsize)rectify->height;
    const float *weight = weights_of(rows, texel);
    wide own[2] = {{0}}, red = {0}, green = {0}, blue = {0};
    for (int y = window->y; y < window->y + window->n_rows; y++) {
        const gsize at = (gsize)y * rectify->stride + window->x;
        wide all = {0};
        for (gsize x = at; x < at + window->n_wide * LANES; x += LANES, weight += LANES) {
            wide value = *(const wide *)weight * *(const wide *)(mosaic + x);
            all += value;
            red += value * *(const wide *)(ratio + x);
            green += value * *(const wide *)(ratio + plane + x);
            blue += value * *(const wide *)(ratio + 2 * plane + x);
        }
        own[y & 1] += all;
    }
    *ret =
        (struct tally){{0}, {rectify_sum_of(&red), rectify_sum_of(&green), rectify_sum_of(&blue)}};
    for (int k = 0; k < 4; k++) {
        const wide *v = &own[k / 2];
        const int from = k % 2;
        ret->own[rectify->phase[k]] +=
            ((*v)[from] + (*v)[from + 2]) + ((*v)[from + 4] + (*v)[from + 6]);
    }
}

/* value_c = gain_c · (own_c + others_c · excess_c), with excess = own · balance / others of the
 * texel's surround: the ratio of the colour that it measures to the one that the guide's ratios
 * predict. It corrects the guide where the light differs: gloss is white on blue cloth too, and
 * light reflected by a red wall is redder than the lamp. */
static inline __attribute__((always_inline)) void
apply_all(const Rectify *rectify, const float *mosaic, const float *ratio, float *ret_rgb) {
    for (int texel = 0; texel < rectify->n_texels; texel++, ret_rgb += 3) {
        struct tally area, around;
        add_up(rectify, &rectify->area, texel, mosaic, ratio, &area);
        add_up(rectify, &rectify->around, texel, mosaic, ratio, &around);
        for (int c = 0; c < 3; c++) {
            const float others = around.others[c], balance = rectify->balance[texel][c];
            const float excess = balance > 0 && others > 0 ? CLAMP(around.own[c] / others * balance,
                                                                   1 / MOST_EXCESS, MOST_EXCESS)
                                                           : 1;
            ret_rgb[c] = rectify->colour_gain[c] * (area.own[c] + area.others[c] * excess);
        }
    }
}

/* value = gain_c · Σ w·m over the texel's area: a plane of "rgb", padded like a mosaic. */
static void apply_plane(const Rectify *rectify, const float *padded, gsize c, float *ret_rgb) {
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *window = &rectify->area.window[texel];
        const float *weight = weights_of(&rectify->area, texel);
        wide sum = {0};
        for (int y = window->y; y < window->y + window->n_rows; y++) {
            const float *from = padded + (gsize)y * rectify->stride + window->x;
            for (int x = 0; x < window->n_wide * LANES; x += LANES, weight += LANES)
                sum += *(const wide *)weight * *(const wide *)(from + x);
        }
        ret_rgb[3 * (gsize)texel + c] = rectify->colour_gain[c] * rectify_sum_of(&sum);
    }
}

/* The dispatch is by hand, see sweep.c. */
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void apply_avx2(const Rectify *rectify, const float *mosaic,
                                                       const float *ratio, float *ret_rgb) {
    apply_all(rectify, mosaic, ratio, ret_rgb);
}
#endif

static void rectify_do_apply(const Rectify *rectify, const float *mosaic, const float *ratio,
                             float *ret_rgb) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        apply_avx2(rectify, mosaic, ratio, ret_rgb);
        return;
    }
#endif
    apply_all(rectify, mosaic, ratio, ret_rgb);
}

/* Copies the mosaic to padded rows with 0 for values that are not finite. FALSE if there were
 * any. */
static gboolean pad(const Rectify *rectify, const float *mosaic, float *ret) {
    const gsize width = (gsize)rectify->width;
    int bad = 0;
    for (gsize y = 0; y < (gsize)rectify->height; y++) {
        const float *from = mosaic + y * width;
        float *to = ret + y * rectify->stride;
        for (gsize x = 0; x < width; x++) {
            const gboolean good = from[x] - from[x] == 0;
            to[x] = good ? from[x] : 0;
            bad |= !good;
        }
        memset(to + width, 0, LANES * sizeof *to);
    }
    return !bad;
}

static gboolean rectify_all_finite(const Rectify *rectify, const struct rows *rows, int texel,
                                   const float *mosaic) {
    const struct window *window = &rows->window[texel];
    const float *weight = weights_of(rows, texel);
    const int columns = window->n_wide * LANES;
    for (gsize c = 0; c < rectify->planes; c++, mosaic += rectify->n_pixels)
        for (int i = 0; i < window->n_rows * columns; i++)
            if (weight[i] != 0 &&
                !isfinite(
                    mosaic[(window->y + i / columns) * rectify->width + window->x + i % columns]))
                return FALSE;
    return TRUE;
}

int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes) {
    g_autofree float *found = NULL;
    const float *ratio = rectify->ratio;
    if (!ratio && rectify->planes == 1) {
        found = find_ratios(rectify, mosaic);
        ratio = found;
    }
    g_autofree float *padded = g_new(float, rectify->stride *(gsize)rectify->height);
    gboolean good = TRUE;
    int holes = 0;
    for (gsize c = 0; c < rectify->planes; c++) {
        good &= pad(rectify, mosaic + c * rectify->n_pixels, padded);
        if (rectify->planes == 3)
            apply_plane(rectify, padded, c, ret_rgb);
        else
            rectify_do_apply(rectify, padded, ratio, ret_rgb);
    }
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        float *rgb = ret_rgb + 3 * (gsize)texel;
        const gboolean seen =
            rectify->area.window[texel].n_rows > 0 && isfinite(rgb[0]) && isfinite(rgb[1]) &&
            isfinite(rgb[2]) &&
            (good || (rectify_all_finite(rectify, &rectify->area, texel, mosaic) &&
                      rectify_all_finite(rectify, &rectify->around, texel, mosaic)));
        holes += !seen;
        if (!seen)
            memset(rgb, 0, 3 * sizeof *rgb);
        if (ret_holes)
            ret_holes[texel] = !seen;
    }
    return holes;
}

/* Copies a texel's area weights to the window of its smooth weights, which holds all of them.
 * Without smooth weights (mono) the window is that of the area. Returns the window. */
static const struct window *rectify_widen(const Rectify *rectify, int texel, float *ret_area) {
    const struct window *area = &rectify->area.window[texel];
    const struct window *window = &rectify->around.window[texel];
    const float *weight = weights_of(&rectify->area, texel);
    window = window->n_rows > 0 ? window : area;
    const int columns = window->n_wide * LANES;
    memset(ret_area, 0, sizeof(float) * window->n_rows * (gsize)columns);
    for (int y = 0; y < area->n_rows; y++)
        for (int x = 0; x < area->n_wide * LANES; x++, weight++) {
            const int column = area->x + x - window->x, row = area->y + y - window->y;
            if (*weight != 0 && column >= 0 && column < columns && row >= 0 && row < window->n_rows)
                ret_area[row * columns + column] = *weight;
        }
    return window;
}

/* Of one texel and each colour: the derivatives of its value by its pixels (see apply_all()), with
 * area weights w, smooth ones a, and ratios r; a clamped excess counts as a constant:
 *   own colour:    ∂/∂m_p = w + own·a,   own = others_c · balance / others of the surround
 *   other colours: ∂/∂m_p = excess·r·(w − other·a),   other = others_c / others of the surround.
 * chroma: how much ln excess differs between adjacent texels, as a mean square. */
struct rectify_slopes {
    float own[3], excess[3], other[3], log_excess[3], chroma[3];
};

static inline __attribute__((always_inline)) struct rectify_slopes
rectify_slopes_of(const Rectify *rectify, int texel, const float *mosaic, const float *ratio) {
    struct rectify_slopes ret = {{0}, {1, 1, 1}, {0}, {0}, {0}};
    struct tally area, around;
    add_up(rectify, &rectify->area, texel, mosaic, ratio, &area);
    add_up(rectify, &rectify->around, texel, mosaic, ratio, &around);
    for (int c = 0; c < 3; c++) {
        const float others = around.others[c], balance = rectify->balance[texel][c];
        if (!(balance > 0 && others > 0))
            continue;
        const float excess = around.own[c] / others * balance;
        ret.excess[c] = CLAMP(excess, 1 / MOST_EXCESS, MOST_EXCESS);
        ret.log_excess[c] = logf(ret.excess[c]);
        if (excess != ret.excess[c])
            continue;
        ret.other[c] = area.others[c] / others;
        ret.own[c] = ret.other[c] * balance;
    }
    return ret;
}

/* Squares of the differences of ln excess between a texel and the one step after it, for each
 * colour; FALSE if either is outside of the picture. */
static gboolean rectify_chroma_step(const Rectify *rectify, const struct rectify_slopes *slopes,
                                    int texel, int step, float ret[3]) {
    if (rectify->area.window[texel].n_rows == 0 || rectify->area.window[texel + step].n_rows == 0)
        return FALSE;
    for (int c = 0; c < 3; c++) {
        const float d = slopes[texel + step].log_excess[c] - slopes[texel].log_excess[c];
        ret[c] = d * d;
    }
    return TRUE;
}

/* chroma of each texel: the mean over the adjacent pairs among the 3 × 3 texels around it. */
static void rectify_find_chroma(const Rectify *rectify, struct rectify_slopes *slopes) {
    const int width = rectify->columns, height = rectify->n_texels / width;
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const int x0 = MAX(texel % width - 1, 0), x1 = MIN(texel % width + 1, width - 1);
        const int y0 = MAX(texel / width - 1, 0), y1 = MIN(texel / width + 1, height - 1);
        float sum[3] = {0}, step[3];
        int pairs = 0;
        for (int y = y0; y <= y1; y++)
            for (int x = x0; x <= x1; x++)
                for (int down = 0; down < 2; down++) {
                    if ((down ? y == y1 : x == x1) ||
                        !rectify_chroma_step(rectify, slopes, y * width + x, down ? width : 1,
                                             step))
                        continue;
                    for (int c = 0; c < 3; c++)
                        sum[c] += step[c];
                    pairs++;
                }
        for (int c = 0; c < 3 && pairs > 0; c++)
            slopes[texel].chroma[c] = sum[c] / (float)pairs;
    }
}

/* A frame in the form needed for errors: padded planes of values, of their variances, and of the
 * picture in red, green and blue, as the guide predicts it from the pixels of other colours. */
struct rectify_frame {
    const float *values, *variances, *colours, *ratio;
    const struct rectify_slopes *slopes;
};

/* noise_c = gain_c² · Σ_p (∂/∂m_p)² · var_p. area: room for the weights of one texel; none: 0s. */
static inline __attribute__((always_inline)) void rectify_noise(const Rectify *rectify, int texel,
                                                                const struct rectify_frame *frame,
                                                                float *area, const float *none,
                                                                float ret[3]) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    const struct rectify_slopes *slopes = &frame->slopes[texel];
    const struct window *window = rectify_widen(rectify, texel, area);
    const gboolean smooth = window != &rectify->area.window[texel];
    const float *around = smooth ? weights_of(&rectify->around, texel) : none, *weight = area;
    wide sum[3] = {{0}};
    for (int y = window->y; y < window->y + window->n_rows; y++) {
        const gsize at = (gsize)y * rectify->stride + window->x;
        const int *phase = &rectify->phase[2 * (y & 1)];
        for (gsize x = at; x < at + window->n_wide * LANES; x += LANES) {
            const wide w = *(const wide *)weight, a = *(const wide *)around;
            const wide variance = *(const wide *)(frame->variances + x);
            for (int c = 0; c < 3; c++) {
                const float even = phase[0] == c, odd = phase[1] == c;
                const wide own = {even, odd, even, odd, even, odd, even, odd};
                const wide r = *(const wide *)(frame->ratio + (gsize)c * plane + x);
                const wide slope = own * (w + slopes->own[c] * a) +
                                   slopes->excess[c] * r * (w - slopes->other[c] * a);
                sum[c] += slope * slope * variance;
            }
            weight += LANES;
            around += LANES;
        }
    }
    for (int c = 0; c < 3; c++)
        ret[c] = rectify->colour_gain[c] * rectify->colour_gain[c] * rectify_sum_of(&sum[c]);
}

/* A texel's area weights, 0 for pixels in the first and last column of the picture. copy: room for
 * them. */
static const float *rectify_inner_weights(const Rectify *rectify, int texel, float *copy) {
    const struct window *window = &rectify->area.window[texel];
    const float *weight = weights_of(&rectify->area, texel);
    const int columns = window->n_wide * LANES, n = window->n_rows * columns;
    if (window->x > 0 && window->x + columns < rectify->width)
        return weight;
    for (int i = 0; i < n; i++) {
        const int x = window->x + i % columns;
        copy[i] = x == 0 || x >= rectify->width - 1 ? 0 : weight[i];
    }
    return copy;
}

/* Sums over a texel's pixels for one colour: of u², of squares of the other colours' predictions,
 * and of slopes along x and y. */
struct rectify_sums {
    wide squares, others, dx, dy;
};

/* LANES pixels of one row in one colour: m is the plane times a factor, which is 1 for the colour's
 * own pixels and the texel's excess for others: here, beside it in the row, and above and below.
 * Λ_p = m_p − mean of the four neighbours is the part of p that they do not predict; half the
 * differences between them are the slopes. other: 0 for the colour's own pixels, otherwise 1. ret:
 * u_p = w_p Λ_p. */
static inline __attribute__((always_inline)) void
rectify_add_structure(const float *plane, gsize stride, wide here, wide aside, wide below,
                      wide other, wide weight, struct rectify_sums *sums, wide *ret) {
    const float *const next = plane + stride, *const last = plane - stride;
    const wide left = *(const wide *)(plane - 1), right = *(const wide *)(plane + 1);
    const wide up = *(const wide *)last, down = *(const wide *)next;
    const wide m = weight * here * *(const wide *)plane, x = weight * aside, y = weight * below;
    const wide u = m - 0.25f * (x * (left + right) + y * (up + down));
    sums->squares += u * u;
    sums->others += other * m * m;
    sums->dx += x * (right - left);
    sums->dy += y * (down - up);
    *ret = u;
}

/* Errors are alike along an edge, and it is not known where edges run: with u_p = w_p Λ_p,
 *   most_c = max(Σ_p u_p², Σ_rows (Σ u_p)², Σ_columns (Σ u_p)², (Σ_p u_p)²),
 *   coherence_c = most_c / Σ_p u_p².
 * Where in a pixel an edge lies gives a variance of κ² most_c. A pixel of another colour is off by
 * how far its colours deviate from the texel's, which no picture shows. In a texel CHROMA_PX across
 * they deviate as much as those of adjacent texels, and the more the fewer pixels it has:
 *   off_c = chroma_c · CHROMA_PX / pixels · Σ_(p of other colours) w_p² m_p²,
 *   detail_c = max(0, κ² (gain_c² most_c − 1.25 noise_c)) + gain_c² coherence_c off_c,
 *   shift_c = gain_c² · ((Σ w ∂m/∂x)² + (Σ w ∂m/∂y)²).
 * down: room for 3 × columns of the window. */
static inline __attribute__((always_inline)) void
rectify_structure(const Rectify *rectify, int texel, const struct rectify_frame *frame,
                  const float *weight, float *down, const float noise[3], float ret_detail[3],
                  float ret_shift[3]) {
    const gsize stride = rectify->stride, plane = stride * (gsize)rectify->height;
    const struct rectify_slopes *slopes = &frame->slopes[texel];
    const struct window *window = &rectify->area.window[texel];
    const int columns = window->n_wide * LANES;
    struct rectify_sums sums[3] = {{{0}}};
    float rows[3] = {0}, total[3] = {0};
    memset(down, 0, sizeof(float) * 3 * (gsize)columns);
    for (int y = window->y; y < window->y + window->n_rows; y++, weight += columns) {
        const int *const here = &rectify->phase[2 * (y & 1)];
        const int *const next = &rectify->phase[2 * (~y & 1)];
        wide row[3] = {{0}};
        if (y == 0 || y == rectify->height - 1)
            continue;
        for (int x = 0; x < columns; x += LANES) {
            const float *p = frame->colours + (gsize)y * stride + window->x + (gsize)x;
            for (int c = 0; c < 3; c++) {
                const float k = slopes->excess[c];
                const float e = here[0] == c ? 1 : k, o = here[1] == c ? 1 : k;
                const float f = next[0] == c ? 1 : k, q = next[1] == c ? 1 : k;
                const float g = here[0] != c, h = here[1] != c;
                const wide even = {e, o, e, o, e, o, e, o}, odd = {o, e, o, e, o, e, o, e};
                const wide below = {f, q, f, q, f, q, f, q}, other = {g, h, g, h, g, h, g, h};
                wide u;
                rectify_add_structure(p + (gsize)c * plane, stride, even, odd, below, other,
                                      *(const wide *)(weight + x), &sums[c], &u);
                *(wide *)(down + c * columns + x) += u;
                row[c] += u;
            }
        }
        for (int c = 0; c < 3; c++) {
            const float sum = rectify_sum_of(&row[c]);
            rows[c] += sum * sum;
            total[c] += sum;
        }
    }
    for (int c = 0; c < 3; c++) {
        const float gain = rectify->colour_gain[c] * rectify->colour_gain[c];
        const float squares = rectify_sum_of(&sums[c].squares),
                    others = rectify_sum_of(&sums[c].others);
        const float dx = 0.5f * rectify_sum_of(&sums[c].dx),
                    dy = 0.5f * rectify_sum_of(&sums[c].dy);
        float most = MAX(MAX(squares, rows[c]), total[c] * total[c]), over_columns = 0;
        for (int x = 0; x < columns; x++)
            over_columns += down[c * columns + x] * down[c * columns + x];
        most = MAX(most, over_columns);
        const float coherence = squares > 0 ? most / squares : 1;
        const float edges = EDGE_DETAIL * (gain * most - 1.25f * noise[c]);
        const float off = slopes->chroma[c] * rectify->chroma * others;
        ret_detail[c] = MAX(edges, 0) + gain * coherence * off;
        ret_shift[c] = gain * (dx * dx + dy * dy);
    }
}

static inline __attribute__((always_inline)) void
rectify_do_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                  float *ret_noise, float *ret_detail, float *ret_shift) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    g_autofree float *found = rectify->ratio ? NULL : find_ratios(rectify, mosaic);
    const float *ratio = rectify->ratio ? rectify->ratio : found;
    g_autofree float *values = g_new0(float, plane), *variances = g_new(float, plane);
    g_autofree float *colours = g_new(float, 3 * plane);
    g_autofree struct rectify_slopes *slopes = g_new(struct rectify_slopes, rectify->n_texels);
    const struct rectify_frame frame = {values, variances, colours, ratio, slopes};
    pad(rectify, mosaic, values);
    pad(rectify, pixels, variances);
    for (gsize c = 0; c < 3; c++)
        for (gsize i = 0; i < plane; i++)
            colours[c * plane + i] =
                values[i] * (ratio[c * plane + i] > 0 ? ratio[c * plane + i] : 1);
    guint most = 0;
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *a = &rectify->area.window[texel], *b = &rectify->around.window[texel];
        most = MAX(most, (guint)MAX(a->n_rows * a->n_wide, b->n_rows * b->n_wide) * LANES);
        slopes[texel] = rectify_slopes_of(rectify, texel, values, ratio);
    }
    rectify_find_chroma(rectify, slopes);
    g_autofree float *area = g_new(float, most), *none = g_new0(float, most);
    g_autofree float *down = g_new(float, 3 * (gsize)most);
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const gsize i = 3 * (gsize)texel;
        rectify_noise(rectify, texel, &frame, area, none, ret_noise + i);
        rectify_structure(rectify, texel, &frame, rectify_inner_weights(rectify, texel, area), down,
                          ret_noise + i, ret_detail + i, ret_shift + i);
    }
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static void
rectify_errors_avx2(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift) {
    rectify_do_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
}
#endif

/* Of one plane of a frame, as if all of its pixels saw the three colours. */
static void rectify_plane_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                                 float *ret_noise, float *ret_detail, float *ret_shift) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        rectify_errors_avx2(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
        return;
    }
#endif
    rectify_do_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
}

/* Of "rgb" each colour's values come from its own plane. */
static void rectify_take_colour(const Rectify *rectify, const float *found, gsize c, float *ret) {
    for (gsize i = c; i < 3 * (gsize)rectify->n_texels; i += 3)
        ret[i] = found[i];
}

void rectify_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift) {
    if (rectify->planes == 1) {
        rectify_plane_errors(rectify, mosaic, pixels, ret_noise, ret_detail, ret_shift);
        return;
    }
    const gsize n = 3 * (gsize)rectify->n_texels;
    g_autofree float *noise = g_new0(float, n), *detail = g_new0(float, n);
    g_autofree float *shift = g_new0(float, n);
    for (gsize c = 0, at = 0; c < rectify->planes; c++, at += rectify->n_pixels) {
        rectify_plane_errors(rectify, mosaic + at, pixels + at, noise, detail, shift);
        rectify_take_colour(rectify, noise, c, ret_noise);
        rectify_take_colour(rectify, detail, c, ret_detail);
        rectify_take_colour(rectify, shift, c, ret_shift);
    }
}

void rectify_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels) {
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *window = &rectify->area.window[texel];
        const float *weight = weights_of(&rectify->area, texel);
        const int columns = window->n_wide * LANES, n = window->n_rows * columns;
        float sum = 0;
        guint8 flags = 0;
        for (int i = 0; i < n; i++)
            sum += weight[i];
        for (int i = 0; i < n; i++)
            if (weight[i] != 0 && fabsf(weight[i]) >= FLAG_WEIGHT * sum)
                flags |=
                    pixels[(window->y + i / columns) * rectify->width + window->x + i % columns];
        ret_texels[texel] = flags;
    }
}
