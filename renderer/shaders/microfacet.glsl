// Transforms the half vector h to the frame of microfacets with the normal n. n differs from the
// normal z of the surface (Kang & Cho 2011). how is an enum method_rotation. Returns (w h_x², w
// h_y², h_n, w). The exact rotation has w = 1 − n_y², and its tangent axes must be divided by √w.
// facet_shine() does this division. For other rotations, w is 1.
vec4 facet_half(vec3 h, vec3 n, int how) {
    float z = dot(n, h);
    if (how == 2)
        return vec4(h.xy * h.xy, z, 1.0);
    vec2 p = vec2(n.z * h.x - n.x * h.z, h.y - n.y * z);
    return vec4(p * p, z, how == 1 ? 1.0 : 1.0000001 - n.y * n.y); // not 0 if n = ±y
}

// Returns diffuse · n·l + specular · facet_shine(). Vectors are in the frame in which x is the
// direction of U.
vec3 facet(vec3 diffuse, vec3 specular, vec2 rough, vec3 n, vec3 v, vec3 l, int how) {
    float nl = dot(n, l);
    if (nl <= 1e-4)
        return vec3(0.0);
    vec3 h = (l + v) / max(length(l + v), 1e-3);
    float shine = facet_shine(rough, facet_half(h, n, how), nl, dot(n, v), dot(h, l));
    return diffuse * nl + specular * shine;
}
