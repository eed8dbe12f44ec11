// Radiance of a point p under the first lamp (of which the share lit arrives), the even sky and all
// further lamps.
uniform float lamp; // brightness of the first lamp

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
