// The share of the first lamp's light that reaches a point, from a shadow map (Wang et al. 2005
// §4.2).
uniform bool shadows; // if FALSE, the light always arrives
uniform sampler2DShadow shadow_map;
uniform vec3 shadow_light; // unit vector towards the lamp
uniform vec3 shadow_right; // direction of the map's +x; its +y is shadow_light × shadow_right
uniform vec3 shadow_range; // shadow_maps_range(): distance at depth 0, length of the range, bias
uniform float shadow_radius;

// Returns the position of p in the map: x, y and the depth z. Within the map, all three are 0 … 1.
vec3 in_map(vec3 p, vec3 towards, vec3 right, vec3 range) {
    vec2 at = vec2(dot(right, p), dot(cross(towards, right), p)) / shadow_radius;
    return vec3(at * 0.5 + 0.5, min((range.x - dot(towards, p) - range.z) / range.y, 1.0));
}

bool outside(vec3 at) {
    return any(lessThan(at.xy, vec2(0.0))) || any(greaterThan(at.xy, vec2(1.0)));
}

// Returns the share of the first lamp's light that arrives at p, 0 … 1.
float lamp_at(vec3 p) {
    if (!shadows)
        return 1.0;
    vec3 at = in_map(p, shadow_light, shadow_right, shadow_range);
    return outside(at) ? 1.0 : texture(shadow_map, at);
}
