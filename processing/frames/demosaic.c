#include "demosaic.h"

#include <math.h>
#include <stdlib.h>

#define NEAR    3      /* pixels aside whose colour counts */
#define NEAR_PX 1.2f   /* standard deviation of how much */
#define ALIKE   0.12f  /* in the logarithm of brightness */
#define OTHER   1e-3f  /* what pixels of another brightness count at least */
#define DARK    0.002f /* of the mean: a ratio to less says nothing */
#define MOST    50.0f  /* of a ratio */

struct picture {
    const guint8 *colour;
    int width, height;
    float *own;   /* the mosaic, colours to one scale */
    float *green; /* everywhere */
    float *level; /* its logarithm */
};

/* Beyond its border a picture is mirrored at the outermost pixels, which keeps colours in place. */
static gsize demosaic_pixel_at(const struct picture *picture, int x, int y) {
    int w = picture->width, h = picture->height;
    x = abs(x) < w ? abs(x) : MAX(2 * (w - 1) - x, 0);
    y = abs(y) < h ? abs(y) : MAX(2 * (h - 1) - y, 0);
    return (gsize)y * (gsize)w + (gsize)x;
}

static float own_at(const struct picture *picture, int x, int y) {
    return picture->own[demosaic_pixel_at(picture, x, y)];
}

/* Green between two of its pixels, corrected by the bend of the pixel's own colour; and how much
 * both change that way. */
static float green_along(const struct picture *picture, int x, int y, int dx, int dy,
                         float *ret_change) {
    float a = own_at(picture, x - dx, y - dy), b = own_at(picture, x + dx, y + dy);
    float bend = 2 * own_at(picture, x, y) - own_at(picture, x - 2 * dx, y - 2 * dy) -
                 own_at(picture, x + 2 * dx, y + 2 * dy);
    *ret_change = fabsf(a - b) + fabsf(bend);
    return 0.5f * (a + b) + 0.25f * bend;
}

static float green_at(const struct picture *picture, int x, int y) {
    float across, down;
    float h = green_along(picture, x, y, 1, 0, &across);
    float v = green_along(picture, x, y, 0, 1, &down);
    float wh = 1 / (across * across + DARK * DARK), wv = 1 / (down * down + DARK * DARK);
    return (wh * h + wv * v) / (wh + wv);
}

static void fill_green(struct picture *picture) {
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            gsize i = demosaic_pixel_at(picture, x, y);
            gboolean green = picture->colour[i] == DEMOSAIC_GREEN;
            picture->green[i] = MAX(green ? picture->own[i] : green_at(picture, x, y), DARK);
            picture->level[i] = logf(picture->green[i]);
        }
}

/* Red and blue, relative to green. */
static void find_colours(const struct picture *picture, const float *weights, int x, int y,
                         float ret[DEMOSAIC_COLOURS]) {
    float level = picture->level[demosaic_pixel_at(picture, x, y)], sum[DEMOSAIC_COLOURS] = {0};
    float green[DEMOSAIC_COLOURS] = {0};
    for (int v = -NEAR; v <= NEAR; v++)
        for (int u = -NEAR; u <= NEAR; u++) {
            gsize k = demosaic_pixel_at(picture, x + u, y + v);
            float other = (picture->level[k] - level) / ALIKE;
            float w = weights[abs(u)] * weights[abs(v)] * (1 / (1 + other * other) + OTHER);
            sum[picture->colour[k]] += w * picture->own[k];
            green[picture->colour[k]] += w * picture->green[k];
        }
    for (int c = 0; c < DEMOSAIC_COLOURS; c++)
        ret[c] = c == DEMOSAIC_GREEN || !(green[c] > 0) ? 1 : sum[c] / green[c];
}

static void fill_ratios(const struct picture *picture, const float *scale, float *ret) {
    float weights[NEAR + 1];
    for (int i = 0; i <= NEAR; i++)
        weights[i] = expf(-0.5f * (float)(i * i) / (NEAR_PX * NEAR_PX));
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            float colours[DEMOSAIC_COLOURS];
            gsize i = demosaic_pixel_at(picture, x, y);
            int mine = picture->colour[i];
            find_colours(picture, weights, x, y, colours);
            for (int c = 0; c < DEMOSAIC_COLOURS; c++) {
                float value = picture->green[i] * colours[c];
                float ratio = (value + DARK) / (MAX(picture->own[i], DARK) + DARK);
                ret[3 * i + (gsize)c] =
                    c == mine ? 1 : CLAMP(ratio, 1 / MOST, MOST) * scale[c] / scale[mine];
            }
        }
}

/* Their means, by which colours are brought to one scale. */
static void demosaic_find_scales(const float *mosaic, const guint8 *colour, gsize n, float *ret) {
    double sum[DEMOSAIC_COLOURS] = {0}, count[DEMOSAIC_COLOURS] = {0};
    for (gsize i = 0; i < n; i++)
        if (isfinite(mosaic[i])) {
            sum[colour[i]] += mosaic[i];
            count[colour[i]]++;
        }
    for (int c = 0; c < DEMOSAIC_COLOURS; c++)
        ret[c] = count[c] > 0 && sum[c] > 0 ? (float)(sum[c] / count[c]) : 1;
}

void demosaic_ratios(const float *mosaic, const guint8 *colour, int width, int height,
                     float *ret_ratio) {
    gsize n = (gsize)width * (gsize)height;
    float scale[DEMOSAIC_COLOURS];
    g_autofree float *own = g_new0(float, n), *green = g_new0(float, n);
    g_autofree float *level = g_new0(float, n);
    struct picture picture = {colour, width, height, own, green, level};
    demosaic_find_scales(mosaic, colour, n, scale);
    for (gsize i = 0; i < n; i++)
        own[i] = isfinite(mosaic[i]) ? MAX(mosaic[i] / scale[colour[i]], 0) : 0;
    fill_green(&picture);
    fill_ratios(&picture, scale, ret_ratio);
}
