/*
 * Local PCA drawn faster than by lpca_view.h and lpca_revised.h: eigen-BRDFs are sampled again on a
 * regular grid of the hemisphere's square (directions.h), for views and for lights, which takes the
 * place of Schneider 2004 §6's elevated concentric map. Between the samples they are linear in the
 * simplex of the four coordinates around (v, l): five samples, while pairs of measured directions
 * take nine, and a 3D texture with one manual step takes sixteen in two filtered fetches.
 *
 * All values of a sample lie together: 16 bytes hold the mean (nine bits per colour and an
 * exponent) and four components (signed bytes, whose scales are in the texels' weights), 16 more
 * bytes the next four. If its four texels belong to one cluster, a pixel takes these fetches, with
 * p = ⌈c/4⌉:
 *
 *   c           directions    texels      eigen-BRDFs                  of these at c = 2, 4, 8
 *   pairs       4 of a cube   1 + 4 p     9 (c + 1)                    27, 45, 81
 *   3D texture  2 of a cube   1 + 4 p     2 (c + 1), filtered (of 8)   6, 10, 18 (48, 80, 144)
 *   this        none          1 + 4 p     5 p                          5, 5, 10
 *
 * None of these fetches is filtered. The samples are in a buffer, so that an address is a sum.
 * bench_lpca_rendering measures how much pictures differ from those of lpca_view.h.
 */
#pragma once

#include "lpca/lpca.h"
#include "method.h"

typedef struct LpcaGrid LpcaGrid; /* belongs to the thread of the GL context */

/* levels: a local PCA and its n − 1 mip levels. n_grid: samples each way, at least 2; 0: as many,
 * up to 16, as LPCA_GRID_BYTES hold. */
#define LPCA_GRID_BYTES ((gsize)128 << 20)
LpcaGrid *lpca_grid_new(struct lpca *const *levels, int n, int n_grid, GError **error);
void lpca_grid_free(LpcaGrid *grid); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaGrid, lpca_grid_free)

extern const struct method method_lpca_grid; /* its material is an LpcaGrid */
