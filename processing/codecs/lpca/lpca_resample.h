/* A local PCA on a regular grid of directions (direction_grid.h), which a graphics card can
 * interpolate in hardware (Schneider 2004 §6). Pure functions, any thread. */
#pragma once

#include "lpca.h"

/* Returns a local PCA whose views and lights are the samples of such a grid (lpca->n_grid is set),
 * with the clusters and weights of lpca. Both are LPCA_FLOAT and LPCA_RGB. The resampled
 * eigen-BRDFs are no longer exactly orthonormal. The error of the result is 0 until
 * lpca_resample_error() has measured it. */
struct lpca *lpca_resample(const struct lpca *lpca, int n_grid, GError **error);

/* Returns ‖X − X̂‖_F / ‖X‖_F of a resampled local PCA at the directions of btf, and stores it as
 * the error of resampled. btf may be another BTF than the one that the local PCA was made from. */
double lpca_resample_error(struct lpca *resampled, const struct btf_matrix *btf, int n_threads);
