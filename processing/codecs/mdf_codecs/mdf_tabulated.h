/* The weights W of an MDF in factors as a table over the square of the hemisphere (directions.h),
 * as shaders read it. Pure functions, any thread. */
#pragma once

#include "directions/directions.h"
#include "mdf_factors.h"

#define MDF_TABULATED_MAPS 4   /* a layer of a texture: its channels */
#define MDF_TABULATED_SIZE 256 /* samples each way */
#define MDF_TABULATED_PAGE ((gsize)MDF_TABULATED_MAPS * MDF_TABULATED_SIZE * MDF_TABULATED_SIZE)

/* Layers that hold so many maps. */
int mdf_factors_layers(int n_terms);

/* (layers + 1) pages of size × size × 4: the W_i of a layer's maps, times 255 since shaders read
 * 8-bit maps as 0 … 1; in the last page W_0. The outermost samples lie on the horizon, so that
 * filtering needs nothing beyond it. views: the directions of the factors. g_free() */
float *mdf_factors_tabulate(const struct mdf_factors *factors, const Directions *views);
