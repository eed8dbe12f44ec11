/*
 * The difference between two forms of a material at the measured directions. Any thread.
 *
 * A codec was fitted to the values at these directions. held_out.h measures its error at directions
 * that it has not seen.
 */
#pragma once

#include "material.h"

struct compare_sums {
    /* ‖A − B‖_F / ‖A‖_F of R, G, B; if A is black, 0 if B is black and otherwise ∞ */
    double error;
    double luminance_error; /* mean of |Y_A − Y_B| (Meseth et al. 2003, Table 1) */
    double delta_e;         /* mean CIEDE2000, relative to the white diffuser of pipeline.h */
    double psnr_db;         /* PSNR of all values (metrics/psnr.h); ∞ if they are equal */
};

struct comparison {
    int n_views, n_lights;
    struct compare_sums all;
    struct compare_sums *views, *lights; /* one for each view and light */
    double largest;                      /* maximum of |A − B| */
    /* Means over pictures of the sample, each in one view under one light. A pixel is a texel.
     * n_pictures is the number of all pairs of views and lights, but at most 64, and fewer if the
     * pictures are large. The pairs are drawn at random, and are the same for every B. */
    int n_pictures;
    double ssim; /* mean of metrics/ssim.h; NaN if the sample has less than 11 × 11 texels */
    double flip; /* mean of metrics/flip.h, at FLIP_PIXELS_PER_DEGREE */
};

/* Both materials must have the same texels and directions (to 0.01°); otherwise the error says what
 * differs. The progress stage is "compare"; work may be NULL. */
struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error);
/* Compares a BTF, with values in memory, with a codec's model of the BTF. Gives the relative RMS
 * error of R, G, B and the mean error of luminance. */
gboolean compare_model(const struct codec *codec, gconstpointer model, const struct btf_matrix *btf,
                       const struct work *work, double *ret_error, double *ret_luminance_error,
                       GError **error);
/* Gives the time in ns of an evaluation of one texel at any view and light, which includes finding
 * the measured directions around them (place.h). The function evaluates random texels in rounds for
 * a twentieth of a second, on one thread. The mean of the fastest round counts. Returns FALSE with
 * an error if the directions of the material are not valid. */
gboolean compare_evaluation_ns(const Material *material, double *ret_ns, GError **error);
void comparison_free(struct comparison *comparison); /* NULL is ignored */
