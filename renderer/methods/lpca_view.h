/*
 * Local PCA on the graphics card as it was first drawn (Schneider 2004 §5): the cluster and the
 * weights of a texel select and mix eigen-BRDFs, each looked up for every pair of the three
 * measured views and the three lights nearest to v and l (direction_cube.h),
 *
 *   BTF(x, v, l) = Σ_{a,b} g_a(v) h_b(l) (E_{0,k(x)}(a, b) + Σ_i w_i(x) E_{i,k(x)}(a, b)).
 *
 * Eigen-BRDFs are halves in the layers of one array texture. The components of a pair lie side by
 * side: they are always fetched together. For c components and four texels of one cluster a pixel
 * takes 4 fetches for directions, 1 + 4 ⌈c/4⌉ for texels and 9 (c + 1) of eigen-BRDFs.
 *
 * With logarithms (LPCA_LOG) the sums over i are logarithms. For each of the four texels, the sum
 * of each pair (a, b) is turned back into a reflectance before the pairs are mixed: at measured
 * directions pictures show what lpca_reconstruct() gives, and between them they are linear as
 * above. The reflectance under an even sky is not linear in the weights and is stored for each
 * texel and view.
 */
#pragma once

#include "lpca/lpca.h"
#include "method.h"

typedef struct LpcaView LpcaView; /* belongs to the thread of the GL context */

/* levels: a local PCA and its n − 1 mip levels, see lpca_levels.h. Copies what it needs. */
LpcaView *lpca_view_new(struct lpca *const *levels, int n, GError **error);
void lpca_view_free(LpcaView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaView, lpca_view_free)

extern const struct method method_lpca; /* its material is an LpcaView */
