// All that lights a point: the lamp, which may cast shadows, the sky, and further lamps far away.
const int MAX_LAMPS = 64; // VIEW_MAX_LAMPS

uniform float lamp; // how bright the first is
uniform int n_lamps;
uniform vec3 lamp_towards[MAX_LAMPS];
uniform vec3 lamp_colours[MAX_LAMPS];

vec3 shade(mat3 frame, vec3 v, float lit) {
    ambient = AMBIENT != 0 ? ambient_light : 0.0;
    vec3 sum = btf(texel, v, frame * light, lit * lamp);
#if LAMPS
    ambient = 0.0;
    for (int k = 0; k < n_lamps; k++)
        sum += lamp_colours[k] * btf(texel, v, frame * lamp_towards[k], 1.0);
#endif
    return sum;
}
