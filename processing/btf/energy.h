/*
 * Plausibility of a BTF: the energy of its reflectance fields, reciprocity, and conservation of
 * energy (Meseth et al. 2003 §4.1). Any thread.
 */
#pragma once

#include "btf_matrix.h"

struct energy {
    int n_views, n_lights;
    /* Luminance Y = 0.2126 R + 0.7152 G + 0.0722 B of f(v, l) = B(v, l) / cos θ_l, of the mean over
     * all texels and of one texel: E_r(v) is the mean over lights, E_i(l) that over views, with
     * equal directions the same where f is reciprocal (Meseth et al. 2003 §4.1), and constant for a
     * diffuser. Lights with cos θ_l ≤ 0.05 are left out of E_r; their E_i is 0. */
    double *e_r, *e_i;             /* n_views, n_lights */
    double *texel_e_r, *texel_e_i; /* of one texel */
    int texel;

    /* Albedo of each light, for the mean over all texels: the share of its light that all views
     * together receive, Σ_v w_v · B(v, l) / cos θ_l. w_v is the share of the hemisphere, weighted
     * by cos θ, that is nearest to view v. More than 1 violates conservation of energy. */
    double *albedo, largest_albedo; /* n_lights */
    double covered_deg;             /* largest θ of a view: beyond it albedo is extrapolated */

    /* Reciprocity: RMS difference of B(v, l) / cos θ_l, the mean over all texels, from that with v
     * and l exchanged where both were measured within 1°, relative to the RMS of their mean. */
    int pairs;
    double asymmetry;
    double texel_asymmetry; /* the same of single texels, which includes parallax and shadows */
};

/* texel: index; −1: the central one. DATA_ERROR_INVALID if there is no such texel. */
struct energy *energy_compute(const struct btf_matrix *btf, int texel, GError **error);
void energy_free(struct energy *energy); /* NULL is ignored */

/* n_views × n_lights: index of the pair (l, v) whose directions are those of (v, l) exchanged; −1
 * if it was not measured within 1°, or cos θ of either is at most 0.05. g_free() */
int *energy_exchanges(const struct btf_layout *layout);
