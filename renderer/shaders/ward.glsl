// The specular part of Ward 1992, times π, with the exponent of Kang & Cho 2011 eq. 3 (see
// lobes.h):
//   √(n·l / n·v) / (4 U V) · exp(−2 ((h_x/U)² + (h_y/V)²) / (1 + h_n))
// (U, V) is rough. half_v is the result of facet_half(). Its first two components are divided by
// its fourth component, w.
float facet_shine(vec2 rough, vec4 half_v, float nl, float nv, float hl) {
    vec2 p = half_v.xy / (rough * rough);
    return sqrt(nl / max(nv, 0.1)) / (4.0 * rough.x * rough.y) *
           exp(-2.0 * (p.x + p.y) / (half_v.w + half_v.w * max(half_v.z, 0.0)));
}
