/*
 * A local PCA on a regular grid of directions (direction_grid.h), which a graphics card
 * interpolates by itself (Schneider 2004 §6). Pure functions, any thread.
 */
#pragma once

#include "lpca/lpca.h"

/* A local PCA whose views and lights are the samples of such a grid (lpca->n_grid says so), with
 * the clusters and weights it had; LPCA_FLOAT and LPCA_RGB, from one that is. Eigen-BRDFs are no
 * longer exactly orthonormal. Its error is 0: lpca_resample_error() knows it. */
struct lpca *lpca_resample(const struct lpca *lpca, int n_grid, GError **error);

/* ‖X − X̂‖_F / ‖X‖_F of a resampled one at the directions of btf, which need not be those that it
 * was made from; also kept in its error. */
double lpca_resample_error(struct lpca *resampled, const struct btf_matrix *btf, int n_threads);
