// The share of the first lamp's light that reaches a point, from a shadow map (Wang et al. 2005
// §4.2).
uniform bool shadows; // if FALSE, the light always arrives
uniform sampler2DShadow shadow_map;
uniform vec3 shadow_light;   // unit vector towards the lamp
uniform vec3 shadow_right;   // direction of the map's +x; its +y is shadow_light × shadow_right
uniform vec3 shadow_range;   // shadow_maps_range(): distance of depth 0, length to depth 1, bias
uniform float shadow_radius; // radius of the mesh; half the width of the map
#ifdef SOFT_SHADOWS
uniform sampler2D shadow_depths; // the depths of shadow_map
uniform float lamp_spread;       // tangent of half the angle that the lamp covers in the sky; 0 for
                                 // sharp shadows
const int LOOKS = 32, FILTER = 64;
#endif

// Returns the position of p in the map: x, y and the depth z. All three are from 0 to 1 if p lies
// within the map.
vec3 in_map(vec3 p, vec3 towards, vec3 right, vec3 range) {
    vec2 at = vec2(dot(right, p), dot(cross(towards, right), p)) / shadow_radius;
    return vec3(at * 0.5 + 0.5, min((range.x - dot(towards, p) - range.z) / range.y, 1.0));
}

bool outside(vec3 at) {
    return any(lessThan(at.xy, vec2(0.0))) || any(greaterThan(at.xy, vec2(1.0)));
}

#ifdef SOFT_SHADOWS
// Returns the direction of point k on a spiral. The directions of successive points are spread
// evenly over the circle.
vec2 spiral(int k) {
    float angle = 2.39996323 * float(k);
    return vec2(cos(angle), sin(angle));
}

// Returns the share of a round lamp's light that arrives at a place in the map (percentage-closer
// soft shadows; Fernando 2005). Seen from the place, the lamp fills a cone. Whatever blocks the
// light lies within this cone. The mean distance of the blockers from the place gives the width of
// the cone at the blockers. The map is filtered over this width.
float soft_lamp_at(vec3 at) {
    // share of the map's width, per unit of depth
    float across = shadow_range.y * lamp_spread / (2.0 * shadow_radius);
    float most = across * at.z, sum = 0.0, n = 0.0;
    // The points are denser near the place. Each point has a weight for the area that it
    // represents.
    for (int k = 0; k < LOOKS; k++) {
        float away = most * (float(k) + 0.5) / float(LOOKS);
        float blocker = textureLod(shadow_depths, at.xy + away * spiral(k), 0.0).r;
        if ((at.z - blocker) * across > away) {
            sum += away * (at.z - blocker);
            n += away;
        }
    }
    if (n == 0.0)
        return texture(shadow_map, at);
    float width = across * sum / n, lit = 0.0;
    for (int k = 0; k < FILTER; k++) {
        float away = width * sqrt((float(k) + 0.5) / float(FILTER));
        lit +=
            textureLod(shadow_map, vec3(at.xy + away * spiral(k), at.z - 0.1 * away / across), 0.0);
    }
    return lit / float(FILTER);
}
#endif

// Returns the share of the first lamp's light that arrives at p, 0 … 1.
float lamp_at(vec3 p) {
    if (!shadows)
        return 1.0;
    vec3 at = in_map(p, shadow_light, shadow_right, shadow_range);
    if (outside(at))
        return 1.0;
#ifdef SOFT_SHADOWS
    if (lamp_spread > 0.0)
        return soft_lamp_at(at);
#endif
    return texture(shadow_map, at);
}
