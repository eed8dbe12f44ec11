/*
 * Local PCA on the graphics card as it was first drawn (Schneider 2004 §5). The cluster and the
 * weights of a texel select and mix eigen-BRDFs. Each eigen-BRDF is looked up for all nine pairs of
 * the three measured views around v and the three measured lights around l. The interpolation
 * weights of the views are g, and those of the lights are h (direction_cube.h):
 *
 *   BTF(x, v, l) = Σ_{a,b} g_a(v) h_b(l) (E_{0,k(x)}(a, b) + Σ_i w_i(x) E_{i,k(x)}(a, b)).
 *
 * k(x) is the cluster of the texel, and E_{0,k} is the mean of the cluster (lpca.h).
 *
 * Eigen-BRDFs are half floats in the layers of one array texture. The components of a pair are
 * stored next to each other, because they are always fetched together. For c components and four
 * texels of one cluster, a pixel takes 4 fetches for directions, 1 + 4 ⌈c/4⌉ for texels and 9 (c +
 * 1) of eigen-BRDFs.
 *
 * With logarithms (LPCA_LOG), the sums over i are logarithms. For each of the four texels, the sum
 * of each pair (a, b) is converted to a reflectance before the pairs are mixed. At measured
 * directions, pictures therefore show the values of lpca_reconstruct(). Between measured
 * directions, reflectance is linear as above. The reflectance under an even sky is not linear in
 * the weights, and is therefore stored for each texel and view.
 */
#pragma once

#include "codecs/lpca/lpca.h"
#include "method.h"

typedef struct LpcaView LpcaView; /* belongs to the thread of the GL context */

/* Makes the view. levels is a local PCA and its n − 1 mip levels; see lpca_levels.h. Copies
 * everything that it needs. Returns NULL on error, for example GPU_ERROR_TOO_LARGE. */
LpcaView *lpca_view_new(struct lpca *const *levels, int n, GError **error);
void lpca_view_free(LpcaView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaView, lpca_view_free)

extern const struct method method_lpca; /* its material is an LpcaView */
