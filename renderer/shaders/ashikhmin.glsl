// The specular part of Ashikhmin and Shirley 2000 (Kang & Cho 2011 eq. 1), times π, without the
// Fresnel factor (see lobes.h):
//   √((U + 1)(V + 1)) / 8 · h_n^e · n·l / (h·l · max(n·l, n·v))
//   e = (U h_x² + V h_y²) / (h_x² + h_y²)
// (U, V) is rough, and half_v is the result of facet_half(). If h is the normal, e is undefined.
// This does not matter, because h_n is then 1.
float facet_shine(vec2 rough, vec4 half_v, float nl, float nv, float hl) {
    float exponent = dot(rough, half_v.xy) / max(half_v.x + half_v.y, 1e-12);
    return sqrt((rough.x + 1.0) * (rough.y + 1.0)) / 8.0 * pow(max(half_v.z, 1e-3), exponent) * nl /
           (max(hl, 1e-3) * max(max(nl, nv), 0.1));
}
