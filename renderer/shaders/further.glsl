// Further lamps, and the share of the light of each that reaches a point. NEAR_LAMPS is defined if
// one of the further lamps is not infinitely far away.
const int MAX_LAMPS = 64; // VIEWER_MAX_LAMPS

uniform int n_lamps;
uniform vec3 lamp_colours[MAX_LAMPS];

#ifdef NEAR_LAMPS
uniform vec4 lamp_places[MAX_LAMPS]; // w = 1: position; w = 0: unit vector towards a far lamp
// The cone of a spot lamp. xyz is the direction in which the lamp shines, and w is −cos outer,
// where outer is half the angle of the cone. All four values are divided by (cos inner − cos
// outer), where inner is half the angle of the inner cone. For other lamps, xyz is 0 and w is 1.
uniform vec4 lamp_cones[MAX_LAMPS];

// Returns the unit direction from p towards lamp k. shines is the irradiance at p on a surface that
// faces the lamp, relative to the irradiance that the lamp would give at the origin if it had no
// cone. It decreases with the square of the distance.
vec3 towards_lamp(int k, vec3 p, out float shines) {
    vec4 place = lamp_places[k], cone = lamp_cones[k];
    shines = 1.0;
    if (place.w < 0.5)
        return place.xyz;
    vec3 way = place.xyz - p;
    float squared = max(dot(way, way), 1e-12);
    vec3 l = way * inversesqrt(squared);
    float inside = clamp(cone.w - dot(cone.xyz, l), 0.0, 1.0);
    shines = dot(place.xyz, place.xyz) / squared * inside * inside;
    return l;
}
#else
uniform vec3 lamp_towards[MAX_LAMPS];

vec3 towards_lamp(int k, vec3 p, out float shines) {
    shines = 1.0;
    return lamp_towards[k];
}
#endif

#if LAMP_SHADOWS
uniform sampler2DArrayShadow further_maps; // like shadow_map, with a layer per lamp

// For a far lamp: the unit vector of the map's +x, like shadow_right. For a near lamp:
// - x is the tangent of half the angle of a map.
// - y is the bias, relative to the distance.
// - z is the layer of the second face of a cube, or −1 if the lamp has only one map.
uniform vec3 further_right[MAX_LAMPS];
uniform vec3 further_range; // shadow_range (shadow.glsl) for far lamps

// Returns the share of the light of far lamp k that arrives at p, 0 … 1.
float far_at(vec3 towards, int k, vec3 p) {
    vec3 at = in_map(p, towards, further_right[k], further_range);
    return outside(at) ? 1.0 : texture(further_maps, vec4(at.xy, float(k), at.z));
}

#ifdef NEAR_LAMPS
// Computes the same as shadow_maps_right().
vec3 map_right(vec3 back) {
    return normalize(cross(abs(back.z) > 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(0.0, 0.0, 1.0), back));
}

// Returns the share of the light of near lamp k that arrives at p, 0 … 1. The depth in the map of a
// near lamp is the distance from the lamp.
float near_at(int k, vec3 p) {
    vec3 map = further_right[k], v = p - lamp_places[k].xyz, size = abs(v);
    vec3 axis = lamp_cones[k].xyz, back;
    float layer = float(k);
    if (map.z < 0.0) {
        back = dot(axis, axis) > 0.0 ? -normalize(axis) : normalize(lamp_places[k].xyz);
    } else {
        int i = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        int face = 2 * i + (v[i] > 0.0 ? 1 : 0);
        back = vec3(i == 0, i == 1, i == 2) * (v[i] > 0.0 ? -1.0 : 1.0);
        layer = face == 0 ? layer : map.z + float(face - 1);
    }
    float along = -dot(v, back);
    if (along <= 0.0)
        return 1.0;
    vec3 right = map_right(back);
    vec2 at = vec2(dot(right, v), dot(cross(back, right), v)) / (along * map.x) * 0.5 + 0.5;
    float range = length(lamp_places[k].xyz) + 2.0 * shadow_radius;
    float depth = min(length(v) * (1.0 - map.y) / range, 1.0);
    return map.z < 0.0 && outside(vec3(at, depth)) ? 1.0
                                                   : texture(further_maps, vec4(at, layer, depth));
}
#endif

// Returns the share of the light of lamp k that arrives at p, 0 … 1.
float further_at(int k, vec3 p) {
#ifdef NEAR_LAMPS
    return lamp_places[k].w > 0.5 ? near_at(k, p) : far_at(lamp_places[k].xyz, k, p);
#else
    return far_at(lamp_towards[k], k, p);
#endif
}
#else
float further_at(int k, vec3 p) {
    return 1.0;
}
#endif
