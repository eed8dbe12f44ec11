/*
 * What a texel looks like, in a few numbers: the principal components of its values from all views
 * and under all lights, and of its depths in all views of the MDF. The distance between two texels'
 * features is that between their apparent BRDFs, up to the components left out.
 */
#pragma once

#include "btf/btf_matrix.h"
#include "mdf/mdf_table.h"

#define TEXEL_FEATURES 12 /* components at most */

struct texel_features {
    int width, height, n;
    double texel_mm;
    float *values;    /* height × width × n */
    double explained; /* share of the variance that the components have, 0 … 1 */
    double relief;    /* share of the MDF in the variance, 0 … 1; 0: none */
};
typedef struct texel_features TexelFeatures;

struct texel_features *texel_features_new(int width, int height, int n, double texel_mm);
void texel_features_free(struct texel_features *features); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TexelFeatures, texel_features_free)

/*
 * Principal components of A, which has one row per texel: all columns of the BTF, and those of the
 * MDF (NULL: none) times s. s² makes the share of the relief in the variance min (1, var (depth) /
 * texel²) times that of the BTF: a relief that is lower than a texel is wide moves nothing by a
 * texel.
 *
 * A is not held: Y = A Ω for a random matrix of signs Ω, Q of Y = QR, then one step of subspace
 * iteration and the components of QᵀA (Halko, Martinsson and Tropp 2011, algorithms 4.4 and 5.1).
 * Components with less than a thousandth of the variance are left out. The result does not depend
 * on the number of threads. DATA_ERROR_INVALID: the MDF has another number of texels.
 */
struct texel_features *texel_features_compute(const struct btf_matrix *btf,
                                              const struct mdf_table *mdf, const struct work *work,
                                              GError **error);

/* Σ_k (a_k − b_k)² */
static inline float texel_features_square(const float *a, const float *b, int n) {
    float sum = 0;
    for (int k = 0; k < n; k++)
        sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sum;
}

/* The features of texel (x, y), n floats. */
static inline const float *texel_features_at(const struct texel_features *f, int x, int y) {
    return f->values + (gsize)f->n * ((gsize)y * (gsize)f->width + (gsize)x);
}

/* The mean of the features over each square of side × side texels whose first texel is (x, y), of
 * the same shape; squares that leave the sample are 0. */
struct texel_features *texel_features_averaged(const struct texel_features *from, int side);
