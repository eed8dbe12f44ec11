/* Reflectance of a local PCA in one pair of directions. Any thread. */
#pragma once

#include "codec/codec.h"

/* As struct codec's evaluate; model: struct lpca. Where it is linear in the weights of texels,
 * those of one cluster are mixed first, so that its eigen-BRDFs are read once: Σ_a Σ_b g_a h_b (Σ_x
 * s_x E_0(a, b) + Σ_i (Σ_x s_x w_i(x)) E_i(a, b)) Of logarithms (LPCA_LOG) each texel and pair of
 * directions is taken back to R, G, B. */
void lpca_evaluate(gconstpointer model, const struct codec_query *query,
                   const struct codec_texels *texels, float ret[3]);
