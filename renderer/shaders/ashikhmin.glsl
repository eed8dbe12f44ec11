// Ashikhmin and Shirley 2000 (seed 003 eq. 1), without Fresnel's factor; see lobes.h. Specular
// part, times π. At the normal, where φ is not defined, the exponent does not matter.
float facet_shine(vec2 rough, vec3 h, float nl, float nv, float hl) {
    vec2 square_h = h.xy * h.xy;
    float exponent = dot(rough, square_h) / max(square_h.x + square_h.y, 1e-12);
    return sqrt((rough.x + 1.0) * (rough.y + 1.0)) / 8.0 * pow(max(h.z, 1e-3), exponent) * nl /
           (max(hl, 1e-3) * max(max(nl, nv), 0.1));
}
