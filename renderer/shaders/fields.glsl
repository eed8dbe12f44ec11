// Reflectance field (Meseth et al. 2003 eq. 1):
//   BTF(x, v, l) = ρ_v(x) · Σ_i s_{v,i}(x, l), with the lobes s_i = max(0, t_i · l)^n_i
// Page 0 has ρ (R, G, B). Page i has the vector t_i and the exponent n_i.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    float sum = 0.0;
    for (int i = 1; i <= N_LOBES; i++)
        sum += lobe(page(texel, slice, i), l);
    return page(texel, slice, 0).rgb * sum;
}
