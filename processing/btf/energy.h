/*
 * What a BTF says of itself: how much light there is in each of its fields, whether it is
 * reciprocal, and whether it gives back no more than it gets (Meseth et al. 2003 §4.1). Any thread.
 */
#pragma once

#include "btf_matrix.h"

struct energy {
    int n_views, n_lights;
    /* Of the mean over all texels and of one of them, luminance Y = 0.2126 R + 0.7152 G + 0.0722 B:
     * E_r of a view is the mean over all lights, E_i of a light that over all views. */
    double *e_r, *e_i;             /* n_views, n_lights */
    double *texel_e_r, *texel_e_i; /* of that texel */
    int texel;

    /* Of each light, of the mean over all texels: what part of its light the views get together,
     * Σ_v w_v · B(v, l) / cos θ_l. w_v is the part of the hemisphere, weighted by cos θ, that is
     * next to the view. More than 1 is more than there is. */
    double *albedo, largest_albedo; /* n_lights */
    double covered_deg;             /* the steepest view: beyond, albedo is a guess */

    /* B(v, l) / cos θ_l of the mean over all texels against the same with v and l exchanged, where
     * both were measured to within 1°: RMS of the difference relative to the RMS of the mean. */
    int pairs;
    double asymmetry;
    double texel_asymmetry; /* the same of all texels alone, which parallax and shadows add to */
};

/* texel: −1 for the one in the middle. DATA_ERROR_INVALID if there is no such texel. */
struct energy *energy_compute(const struct btf_matrix *btf, int texel, GError **error);
void energy_free(struct energy *energy); /* NULL is ignored */
