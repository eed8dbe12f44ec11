// Eigen-BRDFs as measured, for every pair of the three views and the three lights around v and l:
// nine pairs (seed 000 §5).
uniform sampler2DArray brdfs; // x: light · (components + 1) + component, y and layer: see row()
uniform samplerCube view_indices; // of measured directions, as 1/65535; nearest, as all of these
uniform samplerCube view_weights;
uniform samplerCube light_indices;
uniform samplerCube light_weights;
uniform int n_rows; // of a cluster: the views
uniform int clusters_a_layer;
uniform int ambient_column; // a light that is an even sky

ivec3 views, lights; // the directions, and
vec3 g, h;           // how much of each

ivec3 indices(samplerCube map, vec3 d) {
    return ivec3(textureLod(map, d, 0.0).rgb * 65535.0 + 0.5);
}

void prepare(vec3 v, vec3 l, float lit) {
    views = indices(view_indices, v);
    lights = indices(light_indices, l) * (N_COMPONENTS + 1);
    g = textureLod(view_weights, v, 0.0).rgb;
    h = textureLod(light_weights, l, 0.0).rgb * step(0.0, l.z) * lit;
}

vec3 one_pair(int column, ivec2 at, float share, vec4 w[N_PAGES]) {
    vec3 one = share * texelFetch(brdfs, ivec3(column, at), 0).rgb;
    for (int i = 0; i < N_COMPONENTS; i++)
        one += w[i >> 2][i & 3] * texelFetch(brdfs, ivec3(column + i + 1, at), 0).rgb;
    return one;
}

vec3 evaluate(int cluster, float share, vec4 w[N_PAGES]) {
    ivec2 row = ivec2(cluster % clusters_a_layer * n_rows, cluster / clusters_a_layer);
    vec3 sum = vec3(0.0);
    for (int a = 0; a < 3; a++) {
        ivec2 at = row + ivec2(views[a], 0);
        for (int b = 0; b < 3; b++)
            sum += g[a] * h[b] * one_pair(lights[b], at, share, w);
#if AMBIENT
        sum += ambient * g[a] * one_pair(ambient_column, at, share, w);
#endif
    }
    return sum;
}
