/* compare.c and held_out.c share this comparison of any two sources of values. */
#pragma once

#include "compare.h"

/* One of the two forms of a material. */
struct compare_source {
    const char *label; /* name of the form in errors */
    gconstpointer data;
    /* Gives the values of a texel: n_views × n_lights × 3 (R, G, B). Several threads call the
     * function at the same time. */
    void (*values)(gconstpointer data, int texel, float *ret);
};

/* The size of both sources: numbers of texels in each direction, of views and of lights. */
struct compare_size {
    int width, height, n_views, n_lights;
    int max_pictures; /* maximum of n_pictures in struct comparison; 0 for no pictures */
};

#define COMPARE_PICTURES 64

/* Compares two sources of one size, as compare_materials() does. Fails if a value is infinite or
 * NaN, or if the work is cancelled. */
struct comparison *compare_sources(const struct compare_source *a, const struct compare_source *b,
                                   const struct compare_size *size, const struct work *work,
                                   GError **error);
