// Polynomial texture map (Malzbender et al. 2001):
//   reflectance = ρ · Y(l), with Y = C0 lx² + C1 ly² + C2 lx ly + C3 lx + C4 ly + C5
// Page 0 has the colour ρ. Pages 1 and 2 have C0 … C5.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l) {
    vec4 a = page(texel, slice, 1), b = page(texel, slice, 2);
    float y = dot(a, vec4(l.x * l.x, l.y * l.y, l.x * l.y, l.x)) + b.x * l.y + b.y;
    return page(texel, slice, 0).rgb * y;
}
