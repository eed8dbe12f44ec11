// Further lamps, all infinitely far away, and the share of the light of each that reaches a point.
const int MAX_LAMPS = 64; // VIEWER_MAX_LAMPS

uniform int n_lamps;
uniform vec3 lamp_towards[MAX_LAMPS];
uniform vec3 lamp_colours[MAX_LAMPS];

#if LAMP_SHADOWS
uniform sampler2DArrayShadow further_maps;   // as shadow_map, a layer per lamp
uniform vec3 further_right[MAX_LAMPS]; // as shadow_right
uniform vec3 further_range;

float further_at(int k, vec3 p) {
    vec3 at = in_map(p, lamp_towards[k], further_right[k], further_range);
    return outside(at) ? 1.0 : texture(further_maps, vec4(at.xy, float(k), at.z));
}
#else
float further_at(int k, vec3 p) {
    return 1.0;
}
#endif
