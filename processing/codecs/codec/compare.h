/*
 * The difference between two forms of a material at the measured directions. Any thread.
 *
 * A codec was fitted to the values at these directions. held_out.h measures its error at directions
 * that it has not seen.
 */
#pragma once

#include "material.h"

struct compare_sums {
    /* ‖A − B‖_F / ‖A‖_F of R, G, B, where A and B are the values of the materials a and b. If all
     * values of A are 0, the error is 0 if B equals A, and otherwise ∞ */
    double error;
    /* mean of |Y_A − Y_B|, where Y_A and Y_B are the luminances of A and B (Meseth et al. 2003,
     * Table 1) */
    double luminance_error;
    double delta_e; /* mean CIEDE2000; the reference white is the white diffuser */
    double psnr_db; /* PSNR of all values (metrics/psnr.h); ∞ if A and B are equal */
};

struct comparison {
    int n_views, n_lights;
    struct compare_sums all;
    /* views: for each view, over all lights; lights: for each light, over all views */
    struct compare_sums *views, *lights;
    double largest; /* maximum of |A − B| */
    /* ssim and flip are means over n_pictures pictures of the sample. A picture shows the sample in
     * one view under one light, and a pixel is a texel. The pairs of view and light are drawn at
     * random, without repetition. There are at most COMPARE_PICTURES (compare_private.h) pictures,
     * and fewer if they are large. Calls with the same numbers of texels, views and lights draw the
     * same pairs. */
    int n_pictures;
    double ssim; /* mean of metrics/ssim.h; NaN if the sample has less than 11 × 11 texels */
    double flip; /* mean of metrics/flip.h, at FLIP_PIXELS_PER_DEGREE */
};

/* Compares two materials at all texels, views and lights. Fails with DATA_ERROR_INVALID if the
 * widths, the heights or the numbers of views or lights differ, if a direction differs by 0.01° or
 * more, or if a value is infinite or NaN. Also fails if the work is cancelled. The progress stages
 * are "compare" and then "pictures"; work may be NULL. Free with comparison_free(). */
struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error);
/* Compares a model with its BTF, whose values are in memory. Gives `error` and `luminance_error` of
 * struct compare_sums over all views and lights, where A is the BTF and B the model. Fails as
 * compare_materials() does. */
gboolean compare_model(const struct codec *codec, gconstpointer model, const struct btf_matrix *btf,
                       const struct work *work, double *ret_error, double *ret_luminance_error,
                       GError **error);
/* Gives the time in ns that one thread needs to evaluate one texel for one view and one light. This
 * includes finding the measured directions around view and light (place.h). The function evaluates
 * random texels in rounds for a twentieth of a second. The time is the mean of the fastest round.
 * Returns FALSE with an error if the directions of the material are not valid. */
gboolean compare_evaluation_ns(const Material *material, double *ret_ns, GError **error);
void comparison_free(struct comparison *comparison); /* NULL is ignored */
