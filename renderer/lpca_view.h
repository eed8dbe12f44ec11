/*
 * Local PCA on the graphics card, as seed 000 §4 draws it: the cluster and the weights of a texel
 * select and mix eigen-BRDFs, each looked up for every pair of the measured views and lights around
 * v and l,
 *
 *   BTF(x, v, l) = Σ_{a,b} g_a(v) h_b(l) (E_{0,k(x)}(a, b) + Σ_i w_i(x) E_{i,k(x)}(a, b)).
 *
 * Eigen-BRDFs are halves in the layers of one array texture. The components of a pair lie side by
 * side: they are always wanted together. Texels are not mixed before they are evaluated, since
 * neighbours may belong to different clusters; between them the reflectances are bilinear.
 */
#pragma once

#include "method.h"
#include "processing/lpca.h"

typedef struct LpcaView LpcaView; /* belongs to the thread of the GL context */

/* levels: a local PCA and its n − 1 mip levels, see lpca_levels.h. Copies what it needs. */
LpcaView *lpca_view_new(struct lpca *const *levels, int n, GError **error);
void lpca_view_free(LpcaView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaView, lpca_view_free)

extern const struct method method_lpca; /* its material is an LpcaView */
