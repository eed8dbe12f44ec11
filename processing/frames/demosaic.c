#include "demosaic.h"

#include <math.h>
#include <stdlib.h>

/* Weights of the colour-ratio filter, see find_colours(). */
#define RADIUS      3     /* pixels: half the width of the window */
#define SIGMA_PX    1.2f  /* pixels: standard deviation of the Gaussian weight of the distance */
#define LEVEL_SCALE 0.12f /* difference of ln(green) that halves the weight of a pixel */
/* added to the weight that follows from LEVEL_SCALE, so that no pixel has the weight 0 */
#define MIN_WEIGHT 1e-3f
/* lower bound of green, and number added to numerator and denominator of a ratio; relative to the
 * mean of the colour */
#define DARK 0.002f
/* maximum of a ratio of two colours of a pixel, each relative to its mean */
#define MAX_RATIO 50.0f

struct picture {
    const guint8 *colour;
    int width, height;
    float *own;   /* the mosaic, each colour divided by its mean */
    float *green; /* green at every pixel, divided by its mean; at least DARK */
    float *level; /* ln(green) */
};

static gsize pixel_at(const struct picture *picture, int x, int y) {
    const int column = demosaic_mirror(x, picture->width),
              row = demosaic_mirror(y, picture->height);
    return (gsize)row * (gsize)picture->width + (gsize)column;
}

static float own_at(const struct picture *picture, int x, int y) {
    return picture->own[pixel_at(picture, x, y)];
}

/* Returns green at the red or blue pixel (x, y), interpolated in the direction (dx, dy) with a
 * Laplacian correction from the pixel's own colour c (Hamilton and Adams 1997). With neighbours g
 * and c at distances of 1 and 2, G = ½ (g₋₁ + g₊₁) + ¼ (2 c₀ − c₋₂ − c₊₂) and *ret_change = |g₋₁ −
 * g₊₁| + |2 c₀ − c₋₂ − c₊₂|. */
static float green_along(const struct picture *picture, int x, int y, int dx, int dy,
                         float *ret_change) {
    float a = own_at(picture, x - dx, y - dy), b = own_at(picture, x + dx, y + dy);
    float bend = 2 * own_at(picture, x, y) - own_at(picture, x - 2 * dx, y - 2 * dy) -
                 own_at(picture, x + 2 * dx, y + 2 * dy);
    *ret_change = fabsf(a - b) + fabsf(bend);
    return 0.5f * (a + b) + 0.25f * bend;
}

/* Returns green at a red or blue pixel: the mean of green_along() in both directions, weighted by 1
 * / (change² + DARK²). */
static float green_at(const struct picture *picture, int x, int y) {
    float across, down;
    float h = green_along(picture, x, y, 1, 0, &across);
    float v = green_along(picture, x, y, 0, 1, &down);
    float wh = 1 / (across * across + DARK * DARK), wv = 1 / (down * down + DARK * DARK);
    return (wh * h + wv * v) / (wh + wv);
}

/* Returns green for a red or blue pixel if the lens has lateral colour. X is the position of the
 * pixel relative to the centre. The green light of the object point that this pixel sees arrives at
 * X (1 + c_green) / (1 + c_own), with c = larger[] of struct demosaic_lateral. Green is
 * interpolated there by a parabola along the row and one along the column. Each parabola goes
 * through three values of green. The middle one is at the nearest pixel that has the colour of this
 * pixel. The other two are at the green pixels on both sides of the middle one. */
static float green_apart(const struct picture *picture, const struct demosaic_lateral *lateral,
                         int x, int y) {
    const int colour = picture->colour[pixel_at(picture, x, y)];
    const double more = (1 + lateral->larger[DEMOSAIC_GREEN]) / (1 + lateral->larger[colour]) - 1;
    const double dx = (x - lateral->centre_px[0]) * more, dy = (y - lateral->centre_px[1]) * more;
    const int u = x + 2 * (int)lround(dx / 2), v = y + 2 * (int)lround(dy / 2);
    const float s = (float)(x + dx - u), t = (float)(y + dy - v); /* −1 … 1 */
    const float left = own_at(picture, u - 1, v), right = own_at(picture, u + 1, v);
    const float up = own_at(picture, u, v - 1), down = own_at(picture, u, v + 1);
    const float here = green_at(picture, u, v);
    return here + 0.5f * (s * (right - left) + s * s * (left + right - 2 * here)) +
           0.5f * (t * (down - up) + t * t * (up + down - 2 * here));
}

static void fill_green(struct picture *picture, const struct demosaic_lateral *lateral) {
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            gsize i = pixel_at(picture, x, y);
            float value = picture->colour[i] == DEMOSAIC_GREEN ? picture->own[i]
                          : lateral                            ? green_apart(picture, lateral, x, y)
                                                               : green_at(picture, x, y);
            picture->green[i] = MAX(value, DARK);
            picture->level[i] = logf(picture->green[i]);
        }
}

/* Computes the colour ratios c/green at (x, y): ret[c] = Σ w·own / Σ w·green over the pixels of
 * colour c in the window, and 1 for green. w is a bilateral weight:
 *   w = exp(−(u² + v²) / 2σ²) · (1 / (1 + (Δ ln green / LEVEL_SCALE)²) + MIN_WEIGHT) */
static void find_colours(const struct picture *picture, const float *weights, int x, int y,
                         float ret[DEMOSAIC_COLOURS]) {
    float level = picture->level[pixel_at(picture, x, y)], sum[DEMOSAIC_COLOURS] = {0};
    float green[DEMOSAIC_COLOURS] = {0};
    for (int v = -RADIUS; v <= RADIUS; v++)
        for (int u = -RADIUS; u <= RADIUS; u++) {
            gsize k = pixel_at(picture, x + u, y + v);
            float other = (picture->level[k] - level) / LEVEL_SCALE;
            float w = weights[abs(u)] * weights[abs(v)] * (1 / (1 + other * other) + MIN_WEIGHT);
            sum[picture->colour[k]] += w * picture->own[k];
            green[picture->colour[k]] += w * picture->green[k];
        }
    for (int c = 0; c < DEMOSAIC_COLOURS; c++)
        ret[c] = c == DEMOSAIC_GREEN || !(green[c] > 0) ? 1 : sum[c] / green[c];
}

/* Sets ret[3 i + c] to (green·ratio_c + DARK) / (own + DARK) · scale_c / scale_own, the factor from
 * the value of pixel i to colour c in the units of the mosaic. The first quotient is limited to 1 /
 * MAX_RATIO … MAX_RATIO. The factor is 1 for the pixel's own colour. */
static void fill_ratios(const struct picture *picture, const float *scale, float *ret) {
    float weights[RADIUS + 1];
    for (int i = 0; i <= RADIUS; i++)
        weights[i] = expf(-0.5f * (float)(i * i) / (SIGMA_PX * SIGMA_PX));
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            float colours[DEMOSAIC_COLOURS];
            gsize i = pixel_at(picture, x, y);
            int mine = picture->colour[i];
            find_colours(picture, weights, x, y, colours);
            for (int c = 0; c < DEMOSAIC_COLOURS; c++) {
                float value = picture->green[i] * colours[c];
                float ratio = (value + DARK) / (MAX(picture->own[i], DARK) + DARK);
                ret[3 * i + (gsize)c] =
                    c == mine ? 1 : CLAMP(ratio, 1 / MAX_RATIO, MAX_RATIO) * scale[c] / scale[mine];
            }
        }
}

void demosaic_ratios(const float *mosaic, const guint8 *colour, int width, int height,
                     const struct demosaic_lateral *lateral, float *ret_ratio) {
    gsize n = (gsize)width * (gsize)height;
    /* Each colour is divided by the mean of its finite pixels, so that all colours have the same
     * scale. */
    double sum[DEMOSAIC_COLOURS] = {0}, count[DEMOSAIC_COLOURS] = {0};
    float scale[DEMOSAIC_COLOURS];
    g_autofree float *own = g_new0(float, n), *green = g_new0(float, n);
    g_autofree float *level = g_new0(float, n);
    struct picture picture = {colour, width, height, own, green, level};
    for (gsize i = 0; i < n; i++)
        if (isfinite(mosaic[i])) {
            sum[colour[i]] += mosaic[i];
            count[colour[i]]++;
        }
    for (int c = 0; c < DEMOSAIC_COLOURS; c++)
        scale[c] = count[c] > 0 && sum[c] > 0 ? (float)(sum[c] / count[c]) : 1;
    for (gsize i = 0; i < n; i++)
        own[i] = isfinite(mosaic[i]) ? MAX(mosaic[i] / scale[colour[i]], 0) : 0;
    fill_green(&picture, lateral);
    fill_ratios(&picture, scale, ret_ratio);
}
