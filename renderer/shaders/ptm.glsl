// A polynomial of the light (Malzbender et al. 2001).
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    vec4 a = page(texel, slice, 1), b = page(texel, slice, 2);
    float y = dot(a, vec4(l.x * l.x, l.y * l.y, l.x * l.y, l.x)) + b.x * l.y + b.y;
    return page(texel, slice, 0).rgb * y;
}
