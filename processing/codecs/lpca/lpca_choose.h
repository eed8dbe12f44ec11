/* Chooses the numbers of clusters and components. The result is the smallest local PCA that is
 * accurate enough, or the most accurate one that is small enough. */
#pragma once

#include "lpca.h"

struct lpca_target {
    double error;     /* maximum of lpca_error(); 0 if not limited */
    gint64 bytes;     /* maximum of lpca_bytes() after rounding; 0 if not limited */
    int n_components; /* maximum number of components */
    enum lpca_quantise quantise;
    /* n of the grid to which the result will be resampled (lpca_resample.h); 0 if it will not be
     * resampled. The size of the result depends on n. */
    int n_grid;
};

/* Tries 1, 2, 4, … clusters, until two tries in a row do not improve the result, or until there
 * would be more clusters than texels or LPCA_MAX_CLUSTERS. options gives everything except
 * clusters, components, target and nearest.
 *
 * With a target error, returns the smallest local PCA that reaches the error. Its size is at most
 * the target size, or about the size of the BTF in half floats if there is no target size.
 *
 * Without a target error, returns the local PCA with the smallest error that is at most as large as
 * the target size.
 *
 * The result is LPCA_FLOAT. If more clusters do not fit into memory, the best result so far is
 * returned. If no local PCA reaches the target, returns NULL with DATA_ERROR_INVALID, and the
 * message describes the local PCA that comes nearest. */
struct lpca *lpca_choose(const struct btf_matrix *btf, const struct lpca_options *options,
                         const struct lpca_target *target, GError **error);
