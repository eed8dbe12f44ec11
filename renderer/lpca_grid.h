/*
 * Local PCA drawn faster than by lpca_view.h: eigen-BRDFs are sampled anew on a regular
 * grid of the hemisphere's square (directions.h), for views and for lights, which takes the place
 * of seed 000 §5's elevated concentric map. Between the samples they are linear in the simplex of
 * the four coordinates around (v, l): five samples, where the measured directions take up to
 * sixteen and a 3D texture with one manual step sixteen as well, if hidden in the filter. All
 * components of a sample lie side by side. How far this is from lpca_view.h is measured by
 * bench_lpca_rendering.
 */
#pragma once

#include "method.h"
#include "processing/lpca.h"

typedef struct LpcaGrid LpcaGrid; /* belongs to the thread of the GL context */

/* levels: a local PCA and its n − 1 mip levels. n_grid: samples each way, at least 2; 0: as many,
 * up to 16, as LPCA_GRID_BYTES hold. */
#define LPCA_GRID_BYTES ((gsize)128 << 20)
LpcaGrid *lpca_grid_new(struct lpca *const *levels, int n, int n_grid, GError **error);
void lpca_grid_free(LpcaGrid *grid); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaGrid, lpca_grid_free)

extern const struct method method_lpca_grid; /* its material is an LpcaGrid */
