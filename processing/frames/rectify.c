#include "rectify_private.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "demosaic.h"

#define SPACING_PX 0.25 /* pixels: maximum distance between the points that sample a texel */
#define MIN_WEIGHT 0.3f /* minimum sum of a texel's weights, see weigh_texel() */
/* minimum share of a pixel in a texel with which its flags are passed to the texel */
#define FLAG_WEIGHT 0.02f

struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row) {
    return vec3(grid->width_mm * (column / grid->width - 0.5),
                grid->height_mm * (0.5 - row / grid->height), grid->reference_mm);
}

void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance) {
    const struct rig_lamp placed = rig_lamp_placed(arc, lamp, arc_rad);
    const struct rig_rotation turn = rig_rotation(turntable_rad);
    for (int row = 0; row < grid->height; row++)
        for (int column = 0; column < grid->width; column++) {
            const struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
            *ret_irradiance++ = (float)rig_lamp_irradiance(NULL, &placed, 0, rig_rotate(turn, p));
        }
}

/* Sets each pixel's colour. All pixels of a mono sensor, and of the planes of "rgb", count as
 * green. */
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

/* Projects the sample points of a texel. Returns FALSE if any point lies outside of the picture. */
static gboolean project_texel(const struct rig_camera *camera, struct rig_rotation turn,
                              const struct session_grid *grid, int column, int row, int side,
                              struct footprint *ret) {
    ret->n = 0;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            struct vec3 p =
                rectify_point_mm(grid, column + (i + 0.5) / side, row + (j + 0.5) / side);
            double *x = &ret->x[ret->n], *y = &ret->y[ret->n++];
            if (!rig_project(camera, rig_rotate(turn, p), x, y) ||
                !(*x >= 0 && *y >= 0 && *x <= camera->width - 1 && *y <= camera->height - 1))
                return FALSE;
        }
    return TRUE;
}

/* An accumulator of weights. sum has a weight for each pixel. pixels is the list of the pixels to
 * which add_weight() has added. touched says whether a pixel is in the list. */
struct weights {
    float *sum;
    gboolean *touched;
    GArray *pixels; /* of guint32 */
};

static void add_weight(struct weights *weights, guint32 pixel, float weight) {
    if (!weights->touched[pixel])
        g_array_append_val(weights->pixels, pixel);
    weights->touched[pixel] = TRUE;
    weights->sum[pixel] += weight;
}

static guint32 pixel_at(const Rectify *rectify, int x, int y) {
    return (guint32)(demosaic_mirror(y, rectify->height) * rectify->width +
                     demosaic_mirror(x, rectify->width));
}

/* Gives the weights of three adjacent pixels for the value at t (0 … 1) within the middle pixel:
 *   w₋₁ = (3t − 4)t/2 + ½, w₀ = (3 − 3t)t + ½, w₊₁ = (3t − 2)t/2.
 * Within the middle pixel the value is a parabola. The mean of the parabola over the pixel is the
 * pixel's value. At each border the parabola is the mean of the two pixels that meet there. The
 * parabola is the derivative of Keys' cubic (1981, a = −½) through the cumulative sums at the pixel
 * borders. */
static void area_weights(double t, float *ret) {
    ret[0] = (float)((1.5 * t - 2) * t + 0.5);
    ret[1] = (float)((3 - 3 * t) * t + 0.5);
    ret[2] = (float)((1.5 * t - 1) * t);
}

/* Returns whether a pixel has the given colour. ANY stands for all colours. */
#define ANY (-1)
static gboolean is_meant(const Rectify *rectify, guint32 pixel, int colour) {
    return colour == ANY || rectify->colour[pixel] == colour;
}

/* For each pixel of a colour, adds its weight to `weights`. The weight is the mean of w(column) ·
 * w(row) over the sample points, with w from area_weights(). */
static void weigh_pixels(const Rectify *rectify, const struct footprint *footprint, int colour,
                         struct weights *weights) {
    float share = 1.0f / (float)footprint->n, columns[3], rows[3];
    for (int k = 0; k < footprint->n; k++) {
        double x = footprint->x[k] + 0.5, y = footprint->y[k] + 0.5;
        int i = (int)floor(x), j = (int)floor(y);
        area_weights(x - i, columns);
        area_weights(y - j, rows);
        for (int c = 0; c < 9; c++) {
            const guint32 pixel = pixel_at(rectify, i + c % 3 - 1, j + c / 3 - 1);
            if (is_meant(rectify, pixel, colour))
                add_weight(weights, pixel, share * columns[c % 3] * rows[c / 3]);
        }
    }
}

/* Returns the quadratic B-spline B₂(t/2) at a distance of t pixels. Pixels of one colour are two
 * pixels apart. The sum of the spline over these pixels does not depend on the position (partition
 * of unity). */
static float spline(double t) {
    t = fabs(t) / 2;
    return (float)(t < 0.5 ? 0.75 - t * t : t < 1.5 ? 0.5 * (1.5 - t) * (1.5 - t) : 0);
}

/* For each pixel of a colour around the sample points, adds its smooth weight (spline()) to
 * `weights`. apply_all() estimates the colour of the texel's surround with these weights. */
static void weigh_around(const Rectify *rectify, const struct footprint *footprint, int colour,
                         struct weights *weights) {
    for (int k = 0; k < footprint->n; k++) {
        int i0 = (int)floor(footprint->x[k]) - 2, j0 = (int)floor(footprint->y[k]) - 2;
        float columns[6], rows[6];
        for (int c = 0; c < 6; c++) {
            columns[c] = spline(footprint->x[k] - (i0 + c));
            rows[c] = spline(footprint->y[k] - (j0 + c));
        }
        for (int c = 0; c < 36; c++) {
            const guint32 pixel = pixel_at(rectify, i0 + c % 6, j0 + c / 6);
            if (is_meant(rectify, pixel, colour))
                add_weight(weights, pixel, columns[c % 6] * rows[c / 6]);
        }
    }
}

static struct rows new_rows(int n) {
    return (struct rows){g_new0(struct window, n), g_array_new(FALSE, TRUE, sizeof(float))};
}

static void clear_rows(struct rows *rows) {
    g_free(rows->window);
    g_clear_pointer(&rows->weight, g_array_unref);
}

/* Moves the weights from the accumulator to the row of a texel, and sets the accumulator to 0. The
 * window of the row is the smallest one that contains all non-zero weights, begins at an even
 * column and consists of whole vectors. n_rows is 0 if there are no weights. gain is a factor for
 * each pixel; NULL stands for 1. */
static void append_row(const Rectify *rectify, struct rows *rows, int texel,
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

/* Sets balance_c to Σ_{k≠c} w / Σ_{k=c} w over the texel's smooth weights w, where k is the colour
 * of a weight's pixel. If one of the sums is not positive, balance_c is 0. */
static void balance(Rectify *rectify, int texel) {
    const struct window *window = &rectify->around.window[texel];
    const float *weight = rectify_weights_of(&rectify->around, texel);
    const int columns = window->n_wide * LANES;
    float own[3] = {0}, all = 0;
    for (int i = 0; i < window->n_rows * columns; i++) {
        own[rectify->phase[2 * ((window->y + i / columns) & 1) + (i & 1)]] += weight[i];
        all += weight[i];
    }
    for (int c = 0; c < 3; c++)
        rectify->balance[texel][c] = own[c] > 0 && all - own[c] > 0 ? (all - own[c]) / own[c] : 0;
}

/* Gives the shortest and the longest side of a texel in pixels. Returns FALSE if a corner texel
 * is not in front of the camera. The size varies smoothly over the grid, so that the corner
 * texels have the extreme sizes. */
static gboolean sides_px(const struct rig_camera *camera, double turntable_rad,
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

/* Returns the number of sample points of a texel along a side, 2 … 64. The points are at most
 * spacing_px apart, or farther if this would take more than 64. */
static int points_aside(double longest_px, double spacing_px) {
    return (int)CLAMP(ceil(longest_px / spacing_px), 2, 64);
}

static void scale_weights(struct weights *weights, float by) {
    for (guint i = 0; i < weights->pixels->len; i++)
        weights->sum[g_array_index(weights->pixels, guint32, i)] *= by;
}

static float sum_weights(const struct weights *weights) {
    float sum = 0;
    for (guint i = 0; i < weights->pixels->len; i++)
        sum += weights->sum[g_array_index(weights->pixels, guint32, i)];
    return sum;
}

/* With lateral colour, each colour is projected by a camera of its own: camera[k] applies to the
 * pixels of colour[k], k < n. Without lateral colour, n is 1, and the camera applies to all
 * pixels. */
struct sights {
    struct rig_camera camera[3];
    int colour[3], n;
};

static struct sights sights_of(const Rectify *rectify, const struct rig_camera *camera) {
    struct sights ret = {.camera = {*camera}, .colour = {ANY}, .n = 1};
    if (rectify->planes == 3)
        ret.camera[0] = rig_camera_of_colour(camera, DEMOSAIC_GREEN);
    if (!rectify->is_lateral || rectify->mono)
        return ret;
    ret.n = 3;
    for (int c = 0; c < 3; c++) {
        ret.camera[c] = rig_camera_of_colour(camera, c);
        ret.colour[c] = c;
    }
    return ret;
}

/* Computes the weights of the pixels in a texel's area. With lateral colour, the pixels of each
 * colour are weighted according to where they see the texel, and the weights are scaled to the sum
 * 1. If a texel is smaller than a pixel, the place where red light is seen may be a pixel of
 * another colour, and likewise for green and blue. The sum of the weights is then small. If it is
 * below MIN_WEIGHT, all pixels are weighted as if they were green. Returns FALSE if the texel lies
 * outside of the picture. */
static gboolean weigh_texel(const Rectify *rectify, const struct sights *sights,
                            struct rig_rotation turn, const struct session_grid *grid, int column,
                            int row, int side, struct footprint *footprint,
                            struct weights *weights) {
    gboolean inside = TRUE;
    for (int k = 0; inside && k < sights->n; k++) {
        inside = project_texel(&sights->camera[k], turn, grid, column, row, side, footprint);
        if (inside)
            weigh_pixels(rectify, footprint, sights->colour[k], weights);
    }
    const float sum = inside && sights->n > 1 ? sum_weights(weights) : 1;
    if (sum < MIN_WEIGHT) {
        scale_weights(weights, 0);
        project_texel(&sights->camera[DEMOSAIC_GREEN], turn, grid, column, row, side, footprint);
        weigh_pixels(rectify, footprint, ANY, weights);
    } else if (!inside || sights->n > 1) {
        scale_weights(weights, inside ? 1 / sum : 0);
    }
    return inside;
}

static void fill_rows(Rectify *rectify, const struct rig_camera *camera,
                      const struct radiometry_camera *radiometry, double turntable_rad,
                      const struct session_grid *grid, const int *texels) {
    const gsize n = rectify->n_pixels, width = (gsize)camera->width;
    double shortest, longest;
    const gboolean seen = sides_px(camera, turntable_rad, grid, &shortest, &longest);
    const int side = seen ? points_aside(longest, SPACING_PX) : 4;
    const int coarse = seen ? points_aside(longest, 4 * SPACING_PX) : 4;
    rectify->chroma = seen && shortest > 0 ? (float)(CHROMA_PX / shortest) : 1;
    g_autofree double *x = g_new(double, side *side), *y = g_new(double, side *side);
    g_autofree float *gain = g_new(float, n), *sum = g_new0(float, n);
    g_autofree gboolean *touched = g_new0(gboolean, n);
    g_autoptr(GArray) pixels = g_array_new(FALSE, FALSE, sizeof(guint32));
    struct footprint footprint = {x, y, 0};
    struct weights weights = {sum, touched, pixels};
    const struct sights sights = sights_of(rectify, camera);
    const struct rig_rotation turn = rig_rotation(turntable_rad);
    /* The factor from DN/ms to radiance is 1000 / (response · flat field). Colour gains are applied
     * later, to the texels. */
    for (gsize i = 0; i < n; i++)
        gain[i] =
            (float)(1000 / (camera->response * radiometry_flat(camera, radiometry, (int)(i % width),
                                                               (int)(i / width))));
    for (int i = 0; i < rectify->n_texels; i++) {
        const int texel = texels ? texels[i] : i;
        const int column = texel % grid->width, row = texel / grid->width;
        const gboolean inside =
            weigh_texel(rectify, &sights, turn, grid, column, row, side, &footprint, &weights);
        rectify->n_outside += !inside;
        append_row(rectify, &rectify->area, i, &weights, gain);
        for (int k = 0; inside && !rectify->mono && k < sights.n; k++)
            if (project_texel(&sights.camera[k], turn, grid, column, row, coarse, &footprint))
                weigh_around(rectify, &footprint, sights.colour[k], &weights);
        append_row(rectify, &rectify->around, i, &weights, NULL);
        balance(rectify, i);
    }
}

Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error) {
    return rectify_new_at(camera, radiometry, cfa, turntable_rad, grid, NULL,
                          grid->width * grid->height, error);
}

/* Makes the rectification of one plane of "rgb", with the lateral colour of that plane. */
static Rectify *plane_new(const struct rig_camera *camera, int colour,
                          const struct radiometry_camera *radiometry, double turntable_rad,
                          const struct session_grid *grid, const int *texels, int n_texels,
                          GError **error) {
    struct rig_camera own = rig_camera_of_colour(camera, colour);
    memset(own.lateral_colour, 0, sizeof own.lateral_colour);
    return rectify_new_at(&own, radiometry, "rgb", turntable_rad, grid, texels, n_texels, error);
}

Rectify *rectify_new_at(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                        const char *cfa, double turntable_rad, const struct session_grid *grid,
                        const int *texels, int n_texels, GError **error) {
    g_autoptr(Rectify) rectify = g_new0(Rectify, 1);
    rectify->n_texels = n_texels;
    rectify->columns = texels ? n_texels : grid->width;
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
    rectify->lateral.centre_px[0] = camera->cx_px;
    rectify->lateral.centre_px[1] = camera->cy_px;
    for (int c = 0; c < 3; c++) {
        rectify->lateral.larger[c] = camera->lateral_colour[c];
        rectify->is_lateral |= camera->lateral_colour[c] != 0;
    }
    for (int c = 0; c < 3; c++)
        rectify->colour_gain[c] =
            radiometry && radiometry->known
                ? (float)(1 /
                          radiometry
                              ->colour[rectify->mono && rectify->planes == 1 ? DEMOSAIC_GREEN : c])
                : 1;
    fill_rows(rectify, camera, radiometry, turntable_rad, grid, texels);
    if (rectify->planes == 3 && rectify->is_lateral &&
        (!(rectify->red = plane_new(camera, DEMOSAIC_RED, radiometry, turntable_rad, grid, texels,
                                    n_texels, error)) ||
         !(rectify->blue = plane_new(camera, DEMOSAIC_BLUE, radiometry, turntable_rad, grid, texels,
                                     n_texels, error))))
        return NULL;
    if (rectify->n_outside * 100.0 <= rectify->n_texels)
        return g_steal_pointer(&rectify);
    g_set_error(
        error, DATA_ERROR, DATA_ERROR_INVALID,
        "camera %s at turntable %.6g°: %d of %d texels are not in the picture of %d × %d pixels; "
        "point the camera at the sample and calibrate it, or give a smaller sample ([sample] in "
        "the session file; --sample of “mesorig import poses”)",
        camera->name, turntable_rad * 180 / G_PI, rectify->n_outside, rectify->n_texels,
        camera->width, camera->height);
    return NULL;
}

void rectify_free(Rectify *rectify) {
    if (!rectify)
        return;
    rectify_free(rectify->red);
    rectify_free(rectify->blue);
    g_free(rectify->colour);
    g_free(rectify->ratio);
    g_free(rectify->vary);
    g_free(rectify->balance);
    clear_rows(&rectify->area);
    clear_rows(&rectify->around);
    g_free(rectify);
}

float *rectify_find_ratios(const Rectify *rectify, const float *mosaic) {
    const gsize plane = rectify->stride * (gsize)rectify->height;
    float *ratio = g_new0(float, 3 * plane);
    g_autofree float *found = NULL;
    if (!rectify->mono) {
        found = g_new0(float, 3 * rectify->n_pixels);
        demosaic_ratios(mosaic, rectify->colour, rectify->width, rectify->height,
                        rectify->is_lateral ? &rectify->lateral : NULL, found);
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
    g_free(rectify->vary);
    rectify->ratio = rectify_find_ratios(rectify, mosaic);
    rectify->vary = rectify_find_vary(rectify, rectify->ratio);
}

/* Computes value_c = gain_c · (own_c + others_c · excess_c), where own_c and others_c are the sums
 * of struct tally over the texel's area. From the same sums over the texel's surround follows
 * excess_c = own_c · balance_c / others_c.
 *
 * The excess is the measured colour of the surround, divided by the colour that the guide's ratios
 * predict. The excess corrects the ratios where this picture has another colour than the guide. For
 * example, gloss is white even on blue cloth. */
static inline __attribute__((always_inline)) void
apply_all(const Rectify *rectify, const float *mosaic, const float *ratio, float *ret_rgb) {
    for (int texel = 0; texel < rectify->n_texels; texel++, ret_rgb += 3) {
        struct tally area, around;
        rectify_add_up(rectify, &rectify->area, texel, mosaic, ratio, &area);
        rectify_add_up(rectify, &rectify->around, texel, mosaic, ratio, &around);
        for (int c = 0; c < 3; c++) {
            const float others = around.others[c], balance = rectify->balance[texel][c];
            const float excess = balance > 0 && others > 0 ? CLAMP(around.own[c] / others * balance,
                                                                   1 / MAX_EXCESS, MAX_EXCESS)
                                                           : 1;
            ret_rgb[c] = rectify->colour_gain[c] * (area.own[c] + area.others[c] * excess);
        }
    }
}

/* Computes value = gain_c · Σ w·m over the texel's area, with the weights w and the pixels m of a
 * plane of "rgb". The plane is padded like a mosaic. */
static void apply_plane(const Rectify *rectify, const float *padded, gsize c, float *ret_rgb) {
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *window = &rectify->area.window[texel];
        const float *weight = rectify_weights_of(&rectify->area, texel);
        wide sum = {0};
        for (int y = window->y; y < window->y + window->n_rows; y++) {
            const float *from = padded + (gsize)y * rectify->stride + window->x;
            for (int x = 0; x < window->n_wide * LANES; x += LANES, weight += LANES)
                sum += *(const wide *)weight * *(const wide *)(from + x);
        }
        ret_rgb[3 * (gsize)texel + c] = rectify->colour_gain[c] * rectify_sum_of(&sum);
    }
}

/* The version for AVX2 is chosen by hand, for the reason given in sweep.c. */
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void apply_avx2(const Rectify *rectify, const float *mosaic,
                                                       const float *ratio, float *ret_rgb) {
    apply_all(rectify, mosaic, ratio, ret_rgb);
}
#endif

static void do_apply(const Rectify *rectify, const float *mosaic, const float *ratio,
                     float *ret_rgb) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        apply_avx2(rectify, mosaic, ratio, ret_rgb);
        return;
    }
#endif
    apply_all(rectify, mosaic, ratio, ret_rgb);
}

gboolean rectify_pad(const Rectify *rectify, const float *mosaic, float *ret) {
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

static gboolean all_finite(const Rectify *rectify, const struct rows *rows, int texel,
                           const float *mosaic) {
    const struct window *window = &rows->window[texel];
    const float *weight = rectify_weights_of(rows, texel);
    const int columns = window->n_wide * LANES;
    for (int i = 0; i < window->n_rows * columns; i++)
        if (weight[i] != 0 &&
            !isfinite(mosaic[(window->y + i / columns) * rectify->width + window->x + i % columns]))
            return FALSE;
    return TRUE;
}

/* Returns whether all pixels that contribute to a texel are finite, in all planes. These are the
 * pixels with an area weight and those with a smooth weight. */
static gboolean is_finite(const Rectify *rectify, int texel, const float *mosaic) {
    gboolean finite = TRUE;
    for (gsize c = 0; c < rectify->planes; c++) {
        const Rectify *own = rectify_of_plane(rectify, c);
        const float *plane = mosaic + c * rectify->n_pixels;
        finite = finite && all_finite(own, &own->area, texel, plane) &&
                 all_finite(own, &own->around, texel, plane);
    }
    return finite;
}

/* Returns whether a texel lies in the picture, in all planes. */
static gboolean is_inside(const Rectify *rectify, int texel) {
    gboolean inside = TRUE;
    for (gsize c = 0; c < rectify->planes; c++)
        inside = inside && rectify_of_plane(rectify, c)->area.window[texel].n_rows > 0;
    return inside;
}

int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes) {
    g_autofree float *found = NULL;
    const float *ratio = rectify->ratio;
    if (!ratio && rectify->planes == 1) {
        found = rectify_find_ratios(rectify, mosaic);
        ratio = found;
    }
    g_autofree float *padded = g_new(float, rectify->stride *(gsize)rectify->height);
    gboolean good = TRUE;
    int holes = 0;
    for (gsize c = 0; c < rectify->planes; c++) {
        good &= rectify_pad(rectify, mosaic + c * rectify->n_pixels, padded);
        if (rectify->planes == 3)
            apply_plane(rectify_of_plane(rectify, c), padded, c, ret_rgb);
        else
            do_apply(rectify, padded, ratio, ret_rgb);
    }
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        float *rgb = ret_rgb + 3 * (gsize)texel;
        const gboolean seen = is_inside(rectify, texel) && isfinite(rgb[0]) && isfinite(rgb[1]) &&
                              isfinite(rgb[2]) && (good || is_finite(rectify, texel, mosaic));
        holes += !seen;
        if (!seen)
            memset(rgb, 0, 3 * sizeof *rgb);
        if (ret_holes)
            ret_holes[texel] = !seen;
    }
    return holes;
}

static void add_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels) {
    for (int texel = 0; texel < rectify->n_texels; texel++) {
        const struct window *window = &rectify->area.window[texel];
        const float *weight = rectify_weights_of(&rectify->area, texel);
        const int columns = window->n_wide * LANES, n = window->n_rows * columns;
        float sum = 0;
        guint8 flags = 0;
        for (int i = 0; i < n; i++)
            sum += weight[i];
        for (int i = 0; i < n; i++)
            if (weight[i] != 0 && fabsf(weight[i]) >= FLAG_WEIGHT * sum)
                flags |=
                    pixels[(window->y + i / columns) * rectify->width + window->x + i % columns];
        ret_texels[texel] |= flags;
    }
}

void rectify_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels) {
    memset(ret_texels, 0, (gsize)rectify->n_texels);
    add_flags(rectify, pixels, ret_texels);
    if (rectify->red && rectify->blue) {
        add_flags(rectify->red, pixels, ret_texels);
        add_flags(rectify->blue, pixels, ret_texels);
    }
}
