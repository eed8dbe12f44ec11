/* The formula of hemispherical harmonics, which hsh.h states, for one texel of a view. */
#pragma once

#include "codecs/hsh/hsh.h"

/* Computes Σ_i c_i H_i (l) of R, G, B. */
static inline void hsh_formula(const struct hsh *hsh, int view, int texel, const float light[3],
                               float ret[3]) {
    const gsize n_texels = btf_layout_texels(&hsh->layout), n_terms = (gsize)hsh->n_terms;
    const float *values = hsh->values + ((gsize)view * n_texels + (gsize)texel) * n_terms * 3;
    float basis[HSH_MAX_TERMS];
    hsh_basis(light, hsh->n_terms, basis);
    ret[0] = ret[1] = ret[2] = 0;
    for (gsize i = 0; i < 3 * n_terms; i++)
        ret[i % 3] += values[i] * basis[i / 3];
}
