// Ward 1992, with the exponent of seed 003 eq. 3; see lobes.h. Specular part, times π.
float facet_shine(vec2 rough, vec3 h, float nl, float nv, float hl) {
    vec2 p = h.xy / rough;
    return sqrt(nl / max(nv, 0.1)) / (4.0 * rough.x * rough.y) *
           exp(-2.0 * dot(p, p) / (1.0 + max(h.z, 0.0)));
}
