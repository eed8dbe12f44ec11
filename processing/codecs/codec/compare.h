/*
 * The difference between two forms of a material at the measured directions. Any thread.
 */
#pragma once

#include "material.h"

struct compare_sums {
    double error; /* ‖A − B‖_F / ‖A‖_F of R, G, B; where A is black: 0, or ∞ */
    double luminance_error; /* mean of |Y_A − Y_B| (Meseth et al. 2003, Table 1) */
    double delta_e;         /* mean CIEDE2000, white being the diffuser of pipeline.h */
};

struct comparison {
    int n_views, n_lights;
    struct compare_sums all;
    struct compare_sums *views, *lights; /* of each */
    double largest;                      /* |A − B| */
};

/* Both must have the same texels and directions (to 0.01°), else the error says what differs.
 * Stage "compare"; work may be NULL. */
struct comparison *compare_materials(const Material *a, const Material *b, const struct work *work,
                                     GError **error);
/* Compares a BTF, with values in memory, with a codec's model of it: the relative RMS error of R,
 * G, B, and the mean error in luminance. */
gboolean compare_model(const struct codec *codec, gconstpointer model, const struct btf_matrix *btf,
                       const struct work *work, double *ret_error, double *ret_luminance_error,
                       GError **error);
void comparison_free(struct comparison *comparison); /* NULL is ignored */

/* From linear sRGB, 1 being white, to CIE L*a*b* under D65; negative values count as 0. */
void compare_lab(const float rgb[3], double ret[3]);
/* Sharma, Wu & Dalal 2005, with all factors 1. */
double compare_delta_e(const double lab1[3], const double lab2[3]);
