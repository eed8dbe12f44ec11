// Ashikhmin and Shirley 2000 (Kang & Cho 2011 eq. 1), without Fresnel's factor; see lobes.h. Specular
// part, times π. half_v: see facet_half(). At the normal, where φ is not defined, the exponent does
// not matter.
float facet_shine(vec2 rough, vec4 half_v, float nl, float nv, float hl) {
    float exponent = dot(rough, half_v.xy) / max(half_v.x + half_v.y, 1e-12);
    return sqrt((rough.x + 1.0) * (rough.y + 1.0)) / 8.0 * pow(max(half_v.z, 1e-3), exponent) * nl /
           (max(hl, 1e-3) * max(max(nl, nv), 0.1));
}
