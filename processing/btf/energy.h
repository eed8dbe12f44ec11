/*
 * Plausibility of a BTF: the energy of its reflectance fields, reciprocity, and conservation of
 * energy (Meseth et al. 2003 §4.1). Any thread.
 */
#pragma once

#include "btf_matrix.h"

struct energy {
    int n_views, n_lights;
    /* Energies of the reflectance fields (Meseth et al. 2003 §4.1) for f(v, l) = B(v, l) / cos θ_l
     * in luminance, Y = 0.2126 R + 0.7152 G + 0.0722 B. E_r(v) is the mean of f over lights, and
     * E_i(l) is the mean of f over views. Lights with cos θ_l ≤ 0.05 are left out of E_r, and their
     * E_i is 0.
     *
     * If f is reciprocal and views and lights have the same directions, E_r and E_i are equal. For
     * a diffuser E_r and E_i are constant.
     *
     * e_r and e_i belong to the mean over all texels, texel_e_r and texel_e_i to one texel. */
    double *e_r, *e_i;             /* e_r has n_views values, e_i has n_lights */
    double *texel_e_r, *texel_e_i; /* of the texel with the index `texel` */
    int texel;

    /* Albedo of each light for the mean over all texels: the share of the light's energy that all
     * views together receive, Σ_v w_v · B(v, l) / cos θ_l. w_v is the share of the hemisphere,
     * weighted by cos θ, that is nearest to view v. An albedo above 1 violates conservation of
     * energy. */
    double *albedo, largest_albedo; /* albedo: n_lights, 0 for lights with cos θ_l ≤ 0.05 */
    /* largest θ of a view; beyond this angle, albedos use the values of the nearest view */
    double covered_deg;

    /* Reciprocity of the mean over all texels. B(v, l) / cos θ_l is compared with the value for v
     * and l exchanged, if both were measured within 1°. pairs is the number of comparisons.
     * asymmetry is the RMS of the difference of the two values, divided by the RMS of their
     * mean. */
    int pairs;
    double asymmetry;
    /* asymmetry of the values of all single texels; it includes parallax and shadows */
    double texel_asymmetry;
};

/* Computes the energies. texel is an index; −1 means the central texel. The error is
 * DATA_ERROR_INVALID if there is no such texel. Fails also if the scratch file of btf cannot be
 * read. */
struct energy *energy_compute(const struct btf_matrix *btf, int texel, GError **error);
void energy_free(struct energy *energy); /* NULL is ignored */

/* Returns for each pair of a view and a light (n_views × n_lights) the index of the exchanged pair.
 * The view of the exchanged pair has the direction of the light, and its light has the direction of
 * the view. The index is −1 if no such pair was measured within 1°, or if cos θ of the view or the
 * light is at most 0.05; g_free(). */
int *energy_exchanges(const struct btf_layout *layout);
