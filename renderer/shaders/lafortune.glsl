// The model of Lafortune et al. 1997:
//   reflectance = ρ · n·l · (d + Σ_i max(0, C_x v_x l_x + C_y v_y l_y + C_z v_z l_z)^n)
// Page 0 has the colour ρ and the diffuse part d. Page i has the vector C and the exponent n of
// lobe i.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    vec4 colour = page(texel, slice, 0);
    float sum = colour.a;
    for (int i = 1; i <= N_LOBES; i++)
        sum += lobe(page(texel, slice, i), v * l);
    return colour.rgb * (l.z * sum);
}
