// Whether the lamp's light arrives, by a map of how far it gets (seed 004 §4.2).
uniform bool shadows; // else it does
uniform sampler2DShadow shadow_map;
uniform mat4 shadow_matrix; // of world coordinates to the map
uniform vec3 shadow_light;  // unit, towards the lamp
uniform vec3 shadow_range;  // of the map: of depth 0, from 0 to 1, and slack

// 0 … 1 of what arrives at p.
float lamp_at(vec3 p) {
    if (!shadows)
        return 1.0;
    vec2 at = (shadow_matrix * vec4(p, 1.0)).xy * 0.5 + 0.5;
    float z = (shadow_range.x - dot(shadow_light, p) - shadow_range.z) / shadow_range.y;
    bool outside = any(lessThan(at, vec2(0.0))) || any(greaterThan(at, vec2(1.0)));
    return outside ? 1.0 : texture(shadow_map, vec3(at, min(z, 1.0)));
}
