// Eigen-BRDFs in a 3D texture (Schneider 2004 §6); see lpca_revised.h.
//   E(s_v, t_v, s_l, t_l) = (1 − w) S(s_v, t_v, z1) + w S(s_v, t_v, z2)
// S is the texture. (s_v, t_v) is the view and (s_l, t_l) the light, on the square of directions.
// z1 and z2 are the slices for the light, and w is the weight of the second slice.
uniform sampler3D means;       // half floats
uniform sampler3D brdfs;       // signed bytes
uniform samplerCube view_map;  // s_v, t_v
uniform samplerCube light_map; // z1, z2, w
uniform int n_grid;            // samples in each direction
uniform int n_columns;         // number of clusters in a row

vec2 place; // s_v, t_v from the centre of the first sample, in samples
vec3 z;     // z1, z2, w of the light
float lit_share, sky_z;

void prepare(vec3 v, vec3 l, float lit) {
    place = 0.5 + textureLod(view_map, v, 0.0).rg * float(n_grid - 1);
    z = textureLod(light_map, l, 0.0).rgb;
    /* Samples at the horizon are not 0 at the corners of the square of directions. The light would
     * therefore end abruptly at the horizon. Instead, it fades over the last 3°. */
    lit_share = lit * clamp(l.z / 0.05, 0.0, 1.0);
    sky_z = 1.0 - 0.5 / float(n_grid * n_grid + 1);
}

vec3 one_table(sampler3D tables, vec2 at) {
    vec3 sum = lit_share * mix(textureLod(tables, vec3(at, z.x), 0.0).rgb,
                               textureLod(tables, vec3(at, z.y), 0.0).rgb, z.z);
#if AMBIENT
    sum += ambient * textureLod(tables, vec3(at, sky_z), 0.0).rgb;
#endif
    return sum;
}

vec3 evaluate(int cluster, float share, vec4 w[N_PAGES]) {
    ivec2 cell = ivec2(cluster % n_columns, cluster / n_columns);
    vec2 at = vec2(cell * n_grid) + place;
    vec3 sum = share * one_table(means, at / vec2(textureSize(means, 0).xy));
    at.y += float(cell.y * (N_COMPONENTS - 1) * n_grid);
    for (int i = 0; i < N_COMPONENTS; i++) {
        sum += w[i >> 2][i & 3] * one_table(brdfs, at / vec2(textureSize(brdfs, 0).xy));
        at.y += float(n_grid);
    }
    return sum;
}
