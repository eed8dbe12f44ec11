// Diffuse and lobes of (v_x l_x, v_y l_y, v_z l_z), times n·l (Lafortune et al. 1997).
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    vec4 colour = page(texel, slice, 0);
    float sum = colour.a;
    for (int i = 1; i <= N_LOBES; i++)
        sum += lobe(page(texel, slice, i), v * l);
    return colour.rgb * (l.z * sum);
}
