// How microfacets follow a normal n that is not the surface's, z: the squares of x and y of the half
// vector seen from the frame of the facets, both times w, its z, and w (seed 003); see enum
// method_rotation. What is rotated exactly is still of length 1, so that y need not be worked out;
// that x is to be divided by 1 − n_y² is left to who divides anyway.
vec4 facet_half(vec3 h, vec3 n, int how) {
    float z = dot(n, h);
    if (how == 2)
        return vec4(h.xy * h.xy, z, 1.0);
    float x = n.z * h.x - n.x * h.z;
    if (how == 1) {
        float y = -n.x * n.y * h.x + (1.0 - n.y * n.y) * h.y - n.y * n.z * h.z;
        return vec4(x * x, y * y, z, 1.0);
    }
    float w = 1.0000001 - n.y * n.y; // not 0 where n = ±y
    return vec4(x * x, (1.0 - z * z) * w - x * x, z, w);
}

// Diffuse and specular, in the frame whose x is the direction of U.
vec3 facet(vec3 diffuse, vec3 specular, vec2 rough, vec3 n, vec3 v, vec3 l, int how) {
    float nl = dot(n, l);
    if (nl <= 1e-4)
        return vec3(0.0);
    vec3 h = (l + v) / max(length(l + v), 1e-3);
    float shine = facet_shine(rough, facet_half(h, n, how), nl, dot(n, v), dot(h, l));
    return diffuse * nl + specular * shine;
}
