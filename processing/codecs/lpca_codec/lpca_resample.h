/*
 * A local PCA on a regular grid of directions (direction_grid.h), which a graphics card
 * interpolates by itself (Schneider 2004 §6). Pure functions, any thread.
 */
#pragma once

#include "lpca/lpca.h"

/* Returns a local PCA whose views and lights are the samples of such a grid (lpca->n_grid is
 * set), with the clusters and weights of the given one; both are LPCA_FLOAT and LPCA_RGB. Its
 * eigen-BRDFs are no longer exactly orthonormal. Its error is set to 0 until
 * lpca_resample_error() measures it. */
struct lpca *lpca_resample(const struct lpca *lpca, int n_grid, GError **error);

/* Returns ‖X − X̂‖_F / ‖X‖_F of a resampled local PCA at the directions of btf, which need not be
 * the BTF that it was made from; also sets its error. */
double lpca_resample_error(struct lpca *resampled, const struct btf_matrix *btf, int n_threads);
