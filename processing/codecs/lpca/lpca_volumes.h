/* A local PCA as the 3D textures from which Schneider 2004 §6 draws it. Each table is a block of n
 * × n × (n² + 1) samples over a grid of directions (lpca_resample.h). (s, t) are the column and row
 * of a direction in the grid. The indices of a sample are the view (s_v, t_v) and the light t_l · n
 * + s_l. The last light, index n², is a uniform sky. Pure functions, any thread. */
#pragma once

#include "lpca.h"

/* Returns the eigen-BRDFs of a local PCA, sampled on a grid of n_grid × n_grid directions. The
 * result has no weights, and its colours are LPCA_RGB. A local PCA that is already on a grid keeps
 * its grid. The result has floats, even if lpca has 8 bits. The error is DATA_ERROR_INVALID if
 * n_grid is out of range, or if the result does not fit into memory. Free the result with
 * lpca_free(). */
struct lpca *lpca_volumes_on_grid(const struct lpca *lpca, int n_grid, GError **error);

/* Computes one block. values is a table of a local PCA on a grid of n: n² views × n² lights × 3.
 * ret is the block: (n² + 1) lights × n² views × 3. The weights of the samples in the uniform sky
 * follow the trapezoidal rule, because equal areas of the map are equal solid angles. */
void lpca_volumes_block(int n, const float *values, float *ret);

/* Converts values to signed bytes −127 … 127, which a graphics card reads as −1 … 1 (Schneider 2004
 * §6.3). ret_steps gets the n bytes. Returns the largest magnitude of the values, by which the
 * weights must be multiplied. */
float lpca_volumes_quantise(const float *values, gsize n, gint8 *ret_steps);
