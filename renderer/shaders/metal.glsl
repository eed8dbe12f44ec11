// Brushed metal under a normal map; see microfacet_view.c.
uniform sampler2D normals; // n_x, n_y
uniform vec3 diffuse, specular;
uniform vec2 rough;

// See method.h.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    vec2 flat_n = PLACE_TEXTURE(normals, x).xy;
    vec3 n = vec3(flat_n, sqrt(max(1.0 - dot(flat_n, flat_n), 0.0)));
    vec3 shown = facet(diffuse, specular, rough, n, v, l, ROTATION);
    return lit * step(0.0, l.z) * shown + ambient * (diffuse + specular);
}
