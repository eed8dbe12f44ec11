// Ward 1992, with the exponent of Kang & Cho 2011 eq. 3; see lobes.h. Specular part, times π. half_v: see
// facet_half().
float facet_shine(vec2 rough, vec4 half_v, float nl, float nv, float hl) {
    vec2 p = half_v.xy / (rough * rough);
    return sqrt(nl / max(nv, 0.1)) / (4.0 * rough.x * rough.y) *
           exp(-2.0 * (p.x + p.y) / (half_v.w + half_v.w * max(half_v.z, 0.0)));
}
