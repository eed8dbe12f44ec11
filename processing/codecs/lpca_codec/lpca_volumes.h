/*
 * A local PCA as the 3D textures that Schneider 2004 §6 draws it from: each table is a block of n ×
 * n × (n² + 1) samples over a grid of directions (lpca_resample.h), indexed by the view (s_v, t_v)
 * and then by the light t_l · n + s_l; the last light is an even sky. Pure functions, any thread.
 */
#pragma once

#include "lpca/lpca.h"

/* Returns the eigen-BRDFs of a local PCA, sampled on a grid of n_grid, without weights; LPCA_RGB. A
 * local PCA that is already on a grid keeps its own. Values of any kind of file are taken as
 * floats. lpca_free() */
struct lpca *lpca_volumes_on_grid(const struct lpca *lpca, int n_grid, GError **error);

/* values: a table of a local PCA on a grid of n, n² views × n² lights × 3; ret: the block of
 * (n² + 1) × n² × 3. The weight of a sample in an even sky is by the trapezoidal rule: equal areas
 * of the map are equal solid angles. */
void lpca_volumes_block(int n, const float *values, float *ret);

/* Converts to signed bytes, which a card reads as −1 … 1 (Schneider 2004 §6.3); returns the scale
 * that weights are to be multiplied by. */
float lpca_volumes_quantise(const float *values, gsize n, gint8 *ret_steps);
