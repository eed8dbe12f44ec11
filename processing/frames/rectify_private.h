/*
 * Weights and weighted sums of pixels, shared by rectify.c and rectify_errors.c.
 */
#pragma once

#include "demosaic.h"
#include "rectify.h"

#define MAX_EXCESS 10.0f /* bound of the ratio of measured to predicted colour */
#define CHROMA_PX  4.0   /* see rectify_structure(); measured: docs/lab/accuracy.md */

/* Adjacent pixels that one vector instruction sums. */
#define LANES 8
typedef float wide __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* Pixels that a texel has weights for. x is even: a lane has the same filter in every window. */
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
    float (*balance)[3]; /* n_texels: the other colours' weight over its own, in around; 0: none */
    float colour_gain[3];
    float chroma; /* CHROMA_PX / pixels across a texel, in its shortest direction */
    struct demosaic_lateral lateral; /* of the camera; "rgb" has it in red and blue below */
    gboolean is_lateral;             /* it is not 0 */
    Rectify *red, *blue;             /* "rgb" with lateral colour: of these planes; NULL: as all */
    float *ratio; /* planes: factors to R, G and B, 0 for a pixel's own; NULL: no guide */
    float *vary;  /* n_texels × 3, of ratio: rectify_find_vary(); NULL: no guide */
};

/* That of a plane of "rgb". */
static inline const Rectify *rectify_of_plane(const Rectify *rectify, gsize plane) {
    const Rectify *own = plane == DEMOSAIC_RED    ? rectify->red
                         : plane == DEMOSAIC_BLUE ? rectify->blue
                                                  : NULL;
    return own ? own : rectify;
}

/* Demosaicing factors of a mosaic as three padded planes (height × stride each), 0 for a pixel's
 * own colour, so that own and estimated values are summed separately. g_free() */
float *rectify_find_ratios(const Rectify *rectify, const float *mosaic);

/* Variances of the ratios' logarithms from pixel to pixel in each texel: n_texels × 3. g_free() */
float *rectify_find_vary(const Rectify *rectify, const float *ratio);

/* Copies a mosaic to padded rows (height × stride), 0 where not finite; FALSE: it is somewhere. */
gboolean rectify_pad(const Rectify *rectify, const float *mosaic, float *ret);

static inline const float *rectify_weights_of(const struct rows *rows, int texel) {
    return (const float *)(void *)rows->weight->data + rows->window[texel].start;
}

/* Weighted sums over a window: of a colour's pixels, and of what others predict for it. */
struct tally {
    float own[3], others[3];
};

static inline float rectify_sum_of(const wide *value) {
    const float *v = (const float *)value;
    return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}

/* own_c = Σ w·m over pixels of colour c, others_c = Σ w·m·ratio_c over the other pixels. mosaic
 * is padded: its rows have the stride of the ratios. */
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
