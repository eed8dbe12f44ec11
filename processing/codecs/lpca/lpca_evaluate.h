/* Evaluates a local PCA for one view and one light. Any thread. */
#pragma once

#include "codecs/codec/codec.h"

/* This is the function evaluate() of struct codec. model is a struct lpca. In R, G, B the values
 * are linear in the weights. The weights of the texels of one cluster are therefore mixed first,
 * and the eigen-BRDFs of the cluster are read only once:
 *   Σ_a Σ_b g_a h_b (Σ_x s_x E_0(a, b) + Σ_i (Σ_x s_x w_i(x)) E_i(a, b))
 * Here s_x is the share of texel x, g_a is the weight of view a, and h_b is the weight of light b.
 * With LPCA_LOG, the value of each texel, view a and light b is converted to R, G, B before the
 * values are mixed. */
void lpca_evaluate(gconstpointer model, const struct codec_query *query,
                   const struct codec_texels *texels, float ret[3]);
