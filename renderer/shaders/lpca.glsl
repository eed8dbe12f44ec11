// Eigen-BRDFs as measured, for every pair of the views and lights around v and l.
uniform sampler2DArray brdfs; // x: light · (n_components + 1) + component, y and layer: see row()
uniform usampler2D view_indices;
uniform sampler2D view_weights;
uniform usampler2D light_indices;
uniform sampler2D light_weights;
uniform int n_rows; // a cluster: the views and their pole
uniform int clusters_a_layer;
uniform int ambient_column; // a light that is an even sky

uvec4 views, lights; // the directions, and
vec4 g, h;           // how much of each

void prepare(vec3 v, vec3 l, float lit) {
    g = direction_shares(view_indices, view_weights, v, views);
    h = direction_shares(light_indices, light_weights, l, lights) * step(0.0, l.z) * lit;
}

ivec2 row(int cluster, uint at) {
    return ivec2(cluster % clusters_a_layer * n_rows + int(at), cluster / clusters_a_layer);
}

vec3 fetch_brdf(int column, ivec2 at) {
    return texelFetch(brdfs, ivec3(column, at), 0).rgb;
}

// Σ over pairs of g h (E_0 + Σ w_i E_i), i four at a time, in one cluster.
vec3 evaluate(int cluster, vec4 w[MAX_PAGES]) {
    vec3 sum = vec3(0.0);
    for (int a = 0; a < 4; a++) {
        if (g[a] <= 0.0)
            continue;
        ivec2 at = row(cluster, views[a]);
        for (int b = 0; b < 5; b++) {
            float share = g[a] * (b < 4 ? h[b] : ambient);
            if (share <= 0.0)
                continue;
            int column = (b < 4 ? int(lights[b]) : ambient_column) * (n_components + 1);
            vec3 one = fetch_brdf(column, at);
            for (int i = 0; i < n_components; i++)
                one += w[i >> 2][i & 3] * fetch_brdf(column + i + 1, at);
            sum += share * one;
        }
    }
    return sum;
}
