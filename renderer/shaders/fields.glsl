// Seed 001 eq. 1.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    float sum = 0.0;
    for (int i = 1; i <= N_LOBES; i++)
        sum += lobe(page(texel, slice, i), l);
    return page(texel, slice, 0).rgb * sum;
}
