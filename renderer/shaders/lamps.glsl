// All that lights a point p: the lamp, of which so much as lit arrives, the sky, and further lamps.
uniform float lamp; // how bright the first is

vec3 shade(mat3 frame, vec3 v, vec3 p, float lit) {
    ambient = AMBIENT != 0 ? ambient_light : 0.0;
    vec3 sum = btf(texel, v, frame * light, lit * lamp);
#if LAMPS
    ambient = 0.0;
    for (int k = 0; k < n_lamps; k++)
        sum += lamp_colours[k] * btf(texel, v, frame * lamp_towards[k], further_at(k, p));
#endif
    return sum;
}
