/*
 * Weights and weighted sums of pixels, shared by rectify.c and rectify_errors.c.
 */
#pragma once

#include "demosaic.h"
#include "rectify.h"

#define MAX_EXCESS 10.0f /* maximum ratio of measured to predicted colour */
/* size of a texel, in pixels, from which its pixels differ in colour as adjacent texels do
 * (rectify_structure()); measured: docs/lab/accuracy.md */
#define CHROMA_PX 4.0

/* number of adjacent pixels that one vector instruction multiplies and adds */
#define LANES 8
typedef float wide __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* The rectangle of pixels for which a texel has weights: n_rows rows of n_wide vectors of LANES
 * pixels, from column x and row y. x is even, so that a lane has the same colour filter in every
 * window. */
struct window {
    guint32 start; /* index of the first weight; there are n_rows × n_wide × LANES weights */
    guint16 x, y, n_rows, n_wide;
};

struct rows {
    struct window *window; /* for each texel, the rectangle of its weights */
    GArray *weight;        /* of float; 0 outside of the footprint */
};

struct Rectify {
    /* n_texels: number of texels
     * columns: number of texels per row
     * n_outside: number of texels outside of the picture */
    int n_texels, columns, n_outside;
    int width, height; /* size of the mosaic in pixels */
    /* number of values in a padded row; padded, because windows may reach beyond the border */
    gsize stride;
    gsize n_pixels;
    guint8 *colour;     /* colour of each pixel, as in demosaic.h */
    int phase[4];       /* colours of the 2 × 2 filter cell, row by row */
    gboolean mono;      /* TRUE if there is no colour filter: cfa is "mono" or "rgb" */
    gsize planes;       /* planes of a frame: 1, or 3 for "rgb" */
    struct rows area;   /* each pixel's share of the texel's area, times its gain */
    struct rows around; /* smooth weights, for estimating the colour of a texel */
    /* For each texel and colour, a quotient of two sums of smooth weights: the sum over the pixels
     * of other colours, divided by the sum over the pixels of this colour. 0 if one of the sums is
     * not positive. */
    float (*balance)[3];
    float colour_gain[3];
    float chroma; /* CHROMA_PX / pixels across a texel, in its shortest direction */
    /* lateral colour of the camera; for "rgb" the rectifications red and blue below apply it */
    struct demosaic_lateral lateral;
    gboolean is_lateral; /* whether lateral is not 0 */
    /* rectifications of the red and blue planes of "rgb" with lateral colour; NULL if all planes
     * use this one */
    Rectify *red, *blue;
    /* three padded planes: rectify_find_ratios() of the guide; NULL if there is no guide */
    float *ratio;
    /* n_texels × 3: rectify_find_vary() of ratio; NULL if there is no guide */
    float *vary;
};

/* Returns the rectification that applies to a plane of "rgb". */
static inline const Rectify *rectify_of_plane(const Rectify *rectify, gsize plane) {
    const Rectify *own = plane == DEMOSAIC_RED    ? rectify->red
                         : plane == DEMOSAIC_BLUE ? rectify->blue
                                                  : NULL;
    return own ? own : rectify;
}

/* Returns the factors from the pixels of a mosaic to R, G and B (demosaic_ratios()) as three padded
 * planes (height × stride each). The factor of a pixel's own colour is 0 here, not 1, so that
 * measured and estimated values are summed separately. g_free() */
float *rectify_find_ratios(const Rectify *rectify, const float *mosaic);

/* Returns n_texels × 3 variances, one for each texel and colour; g_free(). For each pixel, take the
 * logarithm of colour divided by green. The result is the variance of this logarithm between
 * pixels. */
float *rectify_find_vary(const Rectify *rectify, const float *ratio);

/* Copies a mosaic to padded rows (height × stride). Values that are not finite become 0; returns
 * FALSE if there are any. */
gboolean rectify_pad(const Rectify *rectify, const float *mosaic, float *ret);

static inline const float *rectify_weights_of(const struct rows *rows, int texel) {
    return (const float *)(void *)rows->weight->data + rows->window[texel].start;
}

/* Weighted sums over a window, for each colour: own is over the pixels of this colour; others is
 * over the predictions for this colour from the other pixels. */
struct tally {
    float own[3], others[3];
};

static inline float rectify_sum_of(const wide *value) {
    const float *v = (const float *)value;
    return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}

/* Computes own_c = Σ w·m over the pixels of colour c, and others_c = Σ w·m·ratio_c over the other
 * pixels. w are the weights of the texel and m the values of the mosaic. The rows of the mosaic are
 * padded to rectify->stride. */
static inline __attribute__((always_inline)) void
rectify_add_up(const Rectify *rectify, const struct rows *rows, int texel, const float *mosaic,
               const float *ratio, struct tally *ret) {
    const struct window *window = &rows->window[texel];
    const gsize plane = rectify->stride * (gsize)rectify->height;
    const float *weight = rectify_weights_of(rows, texel);
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
