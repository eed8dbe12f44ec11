// Eigen-BRDFs in a 3D texture; see lpca_revised.h.
uniform sampler3D means; // halves
uniform sampler3D brdfs; // signed bytes
uniform samplerCube view_map;  // s_v, t_v
uniform samplerCube light_map; // z1, z2, w
uniform int n_grid;    // samples each way
uniform int n_columns; // clusters side by side

vec2 place; // s_v, t_v from the centre of the first sample, in samples
vec3 z;     // of the light
float lit_share, sky_z;

void prepare(vec3 v, vec3 l, float lit) {
    place = 0.5 + textureLod(view_map, v, 0.0).rg * float(n_grid - 1);
    z = textureLod(light_map, l, 0.0).rgb;
    lit_share = lit * step(0.0, l.z);
    sky_z = 1.0 - 0.5 / float(n_grid * n_grid + 1);
}

vec3 one_table(sampler3D tables, ivec2 cell) {
    vec2 at = (vec2(cell * n_grid) + place) / vec2(textureSize(tables, 0).xy);
    vec3 sum = lit_share * mix(textureLod(tables, vec3(at, z.x), 0.0).rgb,
                               textureLod(tables, vec3(at, z.y), 0.0).rgb, z.z);
    if (ambient > 0.0)
        sum += ambient * textureLod(tables, vec3(at, sky_z), 0.0).rgb;
    return sum;
}

vec3 evaluate(int cluster, vec4 w[MAX_PAGES]) {
    ivec2 cell = ivec2(cluster % n_columns, cluster / n_columns);
    vec3 sum = one_table(means, cell);
    cell.y *= n_components;
    for (int i = 0; i < n_components; i++)
        sum += w[i >> 2][i & 3] * one_table(brdfs, cell + ivec2(0, i));
    return sum;
}
