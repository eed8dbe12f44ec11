// How microfacets follow a normal n that is not the surface's, z: the half vector seen from the
// frame of the facets (seed 003); see enum method_rotation.
vec3 facet_half(vec3 h, vec3 n, int how) {
    float z = dot(n, h);
    if (how == 2)
        return vec3(h.xy, z);
    if (how == 1)
        return vec3(n.z * h.x - n.x * h.z,
                    -n.x * n.y * h.x + (1.0 - n.y * n.y) * h.y - n.y * n.z * h.z, z);
    float size = length(n.xz);
    vec3 u = size > 1e-6 ? vec3(n.z, 0.0, -n.x) / size : vec3(1.0, 0.0, 0.0);
    return vec3(dot(u, h), dot(cross(n, u), h), z);
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
