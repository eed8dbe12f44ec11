/*
 * Local PCA, drawn faster than by lpca_view.h and lpca_revised.h. The eigen-BRDFs are resampled on
 * a regular grid of the hemisphere's square (directions.h), for views and for lights. The square
 * replaces the elevated concentric map of Schneider 2004 §6. Between the samples, the eigen-BRDFs
 * are linear in the simplex of the four coordinates around (v, l).
 *
 * This takes five samples. The other methods take more: lpca_view.h takes nine, for three measured
 * views and three measured lights. lpca_revised.h takes sixteen in two filtered fetches of a 3D
 * texture, and the shader interpolates the fourth coordinate.
 *
 * All values of a sample are stored together. The first 16 bytes have the mean and four components.
 * The mean has nine bits per colour and an exponent. Components are signed bytes, and their scales
 * are included in the weights of the texels. Each further 16 bytes have further components.
 *
 * The table gives the fetches of a pixel for c components, with p = ⌈c/4⌉, if the four texels
 * around the pixel belong to one cluster:
 *
 *               directions    texels      eigen-BRDFs                  eigen-BRDFs at c = 2, 4, 8
 *   pairs       4 of a cube   1 + 4 p     9 (c + 1)                    27, 45, 81
 *   3D texture  2 of a cube   1 + 4 p     2 (c + 1), filtered (of 8)   6, 10, 18 (48, 80, 144)
 *   this        none          1 + 4 p     5 p                          5, 5, 10
 *
 * This method filters none of its fetches. The samples are in a buffer, so that an address is a
 * sum. bench_lpca_rendering measures the difference between these pictures and those of
 * lpca_view.h.
 */
#pragma once

#include "codecs/lpca/lpca.h"
#include "method.h"

typedef struct LpcaGrid LpcaGrid; /* belongs to the thread of the GL context */

/* Maximum number of bytes of the buffer of samples if the grid is chosen automatically. */
#define LPCA_GRID_BYTES ((gsize)128 << 20)
/* Makes the view. levels is a local PCA and its n − 1 mip levels. n_grid is the number of samples
 * in each direction, from 2 to 1000. If n_grid is 0, the number is as large as LPCA_GRID_BYTES and
 * the graphics card allow, but at most 16. */
LpcaGrid *lpca_grid_new(struct lpca *const *levels, int n, int n_grid, GError **error);
void lpca_grid_free(LpcaGrid *grid); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaGrid, lpca_grid_free)

extern const struct method method_lpca_grid; /* its material is an LpcaGrid */
