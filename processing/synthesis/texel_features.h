/* The appearance of a texel in a few numbers: the principal components of its values in all views
 * under all lights, and of its depths in all views of the MDF. The distance between the features of
 * two texels is the distance between their apparent BRDFs, except for the components that are left
 * out. */
#pragma once

#include "btf/btf_matrix.h"
#include "mdf/mdf_table.h"

#define TEXEL_FEATURES 12 /* maximum number of components */

struct texel_features {
    int width, height, n;
    double texel_mm;
    float *values;    /* height × width × n: the components of each texel */
    double explained; /* share of the variance that the components explain, 0 … 1 */
    double relief;    /* share of the MDF in the variance, 0 … 1; 0 if there is no MDF */
};
typedef struct texel_features TexelFeatures;

struct texel_features *texel_features_new(int width, int height, int n, double texel_mm);
void texel_features_free(struct texel_features *features); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TexelFeatures, texel_features_free)

/* Computes the principal components of A, which has one row per texel. Its columns are all columns
 * of the BTF, and all columns of the MDF (NULL if there is none) multiplied by s. s² is chosen so
 * that the share of the relief in the variance is min (1, var (depth) / texel²) times the share of
 * the BTF. The share is smaller for a flat relief, because a relief whose depths vary by less than
 * a texel moves no point by a texel.
 *
 * A is not held in memory. Y = A Ω is computed for a random matrix of signs Ω, then Q of Y = QR.
 * One step of subspace iteration follows, and then the components of QᵀA (Halko, Martinsson and
 * Tropp 2011, algorithms 4.4 and 5.1). Components with less than a thousandth of the variance are
 * left out. The result does not depend on the number of threads. The progress stage is
 * "components".
 *
 * The error is DATA_ERROR_INVALID if the MDF has another number of texels than the BTF, or if the
 * sample has fewer than 20 texels. Fails also if the scratch file of the BTF cannot be read, or if
 * cancelled. */
struct texel_features *texel_features_compute(const struct btf_matrix *btf,
                                              const struct mdf_table *mdf, const struct work *work,
                                              GError **error);

/* Returns Σ_k (a_k − b_k)². */
static inline float texel_features_square(const float *a, const float *b, int n) {
    float sum = 0;
    for (int k = 0; k < n; k++)
        sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sum;
}

/* Returns the features of texel (x, y), n floats. */
static inline const float *texel_features_at(const struct texel_features *f, int x, int y) {
    return f->values + (gsize)f->n * ((gsize)y * (gsize)f->width + (gsize)x);
}

/* Returns, for each texel (x, y), the mean of the features over the square of side × side texels
 * whose first texel is (x, y). The result has the shape of the features. It is 0 for squares that
 * extend beyond the sample. */
struct texel_features *texel_features_averaged(const struct texel_features *from, int side);
