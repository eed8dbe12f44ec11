/* Chooses the numbers of clusters and components: the smallest local PCA that is good enough, or
 * the best one that is small enough. */
#pragma once

#include "lpca.h"

struct lpca_target {
    double error;     /* to reach, or 0 */
    gint64 bytes;     /* lpca_bytes() once rounded, at most; or 0 */
    int n_components; /* at most */
    enum lpca_quantise quantise;
    int n_grid; /* of the eigen-BRDFs whose size counts, see resample.h; or 0 */
};

/* Tries 1, 2, 4, … clusters, as long as that helps. options gives everything but clusters,
 * components and target. With a target error, returns the smallest local PCA that reaches it within
 * the target size; else the one with the least error within that size. The result is LPCA_FLOAT. If
 * none reaches the target, the error names the one that comes nearest. */
struct lpca *lpca_choose(const struct btf_matrix *btf, const struct lpca_options *options,
                         const struct lpca_target *target, GError **error);
