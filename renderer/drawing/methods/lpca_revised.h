/*
 * Local PCA as Schneider 2004 §6 draws it. The eigen-BRDFs are sampled on a regular grid of the
 * elevated concentric map, for views and for lights (lpca_resample.h). Let n be the number of
 * samples in each direction of the grid. A 3D texture has n volumes for each table, one for each
 * sample of t_l. A volume has the axes (s_v, t_v, s_l). The volumes are stacked along the third
 * axis. The card interpolates three of the four coordinates, and the shader the fourth:
 *
 *   E(s_v, t_v, s_l, t_l) = (1 − w) S(s_v, t_v, z1) + w S(s_v, t_v, z2).
 *
 * S is a filtered fetch of the 3D texture. A filtered cube map gives (s_v, t_v) of a view. Another
 * cube map gives (z1, z2, w) of a light. It cannot be filtered, because z jumps from one volume to
 * the next; its angular resolution is a quarter of a degree. A volume ends at the centres of its
 * outermost samples, so that filtering never mixes neighbouring volumes along any axis.
 *
 * The E_i with i ≥ 1 are signed bytes. Their scales are multiplied into the weights of the texels
 * beforehand. The means E_0 are half floats. Their weight is always 1, so the steps of bytes would
 * be visible.
 */
#pragma once

#include "codecs/lpca/lpca.h"
#include "method.h"

typedef struct LpcaRevised LpcaRevised; /* belongs to the thread of the GL context */

/* Maximum number of bytes of the 3D textures if the grid is chosen automatically. */
#define LPCA_REVISED_BYTES ((gsize)128 << 20)
/* Makes the view. levels is a local PCA and its n − 1 mip levels. Copies everything that it needs.
 * A level that is not on a grid yet is resampled to n_grid samples in each direction
 * (lpca_resample.h has the limits). If n_grid is 0, the number is as large as LPCA_REVISED_BYTES
 * allows, but at most 16. */
LpcaRevised *lpca_revised_new(struct lpca *const *levels, int n, int n_grid, GError **error);
void lpca_revised_free(LpcaRevised *revised); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LpcaRevised, lpca_revised_free)

extern const struct method method_lpca_revised; /* its material is an LpcaRevised */
