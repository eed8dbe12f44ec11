/* The weights W of an MDF in factors as a table over the square of the hemisphere (directions.h),
 * in the form that shaders read. Pure functions, any thread. */
#pragma once

#include "directions/directions.h"
#include "mdf_factors.h"

#define MDF_TABULATED_MAPS 4   /* maps in a layer of a texture: one in each channel */
#define MDF_TABULATED_SIZE 256 /* number of samples in each dimension */
#define MDF_TABULATED_PAGE ((gsize)MDF_TABULATED_MAPS * MDF_TABULATED_SIZE * MDF_TABULATED_SIZE)

/* Returns the number of layers that n_terms maps need. */
int mdf_factors_layers(int n_terms);

/* Returns (layers + 1) pages of size × size × 4. Each page but the last contains the weights W_i of
 * the maps of one layer, times 255 because shaders read 8-bit maps as 0 … 1. The last page contains
 * W_0. The outermost samples lie on the horizon, so that filtering never reads beyond the horizon.
 * views are the directions of the factors. g_free() */
float *mdf_factors_tabulate(const struct mdf_factors *factors, const Directions *views);
