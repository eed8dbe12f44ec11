/* A local PCA on a regular grid of directions (direction_grid.h), which a graphics card can
 * interpolate in hardware (Schneider 2004 §6). Any thread. */
#pragma once

#include "lpca.h"

/* Returns a local PCA with the clusters and weights of lpca, whose views and lights are the samples
 * of a grid of n_grid × n_grid directions. lpca must be LPCA_FLOAT, LPCA_RGB and not on a grid. The
 * resampled eigen-BRDFs are no longer exactly orthonormal. The error of the result is 0 until
 * lpca_resample_error() has measured it. Returns NULL with DATA_ERROR_INVALID if
 * direction_grid_operator() fails, or if the result does not fit into memory. */
struct lpca *lpca_resample(const struct lpca *lpca, int n_grid, GError **error);

/* Returns ‖X − X̂‖_F / ‖X‖_F of a resampled local PCA at the directions of btf, and stores it as
 * the error of resampled. The result is NaN if a file of btf cannot be read, and 0 if all values of
 * btf are 0. btf may have other directions than the BTF from which the local PCA was made, but must
 * have the same width and height. n_threads 0 means one thread per processor. */
double lpca_resample_error(struct lpca *resampled, const struct btf_matrix *btf, int n_threads);
