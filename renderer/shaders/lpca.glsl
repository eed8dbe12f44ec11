// Eigen-BRDFs as measured, mixed for the three measured views around v and the three measured
// lights around l. These are the nine pairs (a, b) (Schneider 2004 §5):
//   BTF(x, v, l) = Σ_{a,b} g_a(v) h_b(l) (E_0(a, b) + Σ_i w_i(x) E_i(a, b)).
uniform sampler2DArray brdfs;     // x: light · (components + 1) + component; y and layer: see row
                                  // in evaluate()
uniform samplerCube view_indices; // indices of measured directions, in units of 1/65535; like all
                                  // these textures, it is not filtered
uniform samplerCube view_weights;
uniform samplerCube light_indices;
uniform samplerCube light_weights;
uniform int n_rows; // rows of a cluster: the views
uniform int clusters_a_layer;
uniform int ambient_column; // the column of an even sky; not used with logarithms
#if LOG
uniform sampler2DArray
    skies; // with logarithms: reflectance of each texel under an even sky, a layer per view
#endif

// views: indices of the three measured views around v; g: their barycentric weights. lights: first
// columns of the three measured lights around l; h: their barycentric weights.
ivec3 views, lights;
vec3 g, h;

ivec3 indices(samplerCube map, vec3 d) {
    return ivec3(textureLod(map, d, 0.0).rgb * 65535.0 + 0.5);
}

void prepare(vec3 v, vec3 l, float lit) {
    views = indices(view_indices, v);
    lights = indices(light_indices, l) * (N_COMPONENTS + 1);
    g = textureLod(view_weights, v, 0.0).rgb;
#if ALONG
    // Here v is a measured view (along.glsl), so only this view should have a weight. The other
    // views have small weights, because the weights are those of a whole cell of the cube map.
    g *= step(0.01, g);
    g /= dot(g, vec3(1.0));
#endif
    h = textureLod(light_weights, l, 0.0).rgb * step(0.0, l.z) * lit;
}

vec3 one_pair(int column, ivec2 at, float share, vec4 w[N_PAGES]) {
    vec3 one = share * texelFetch(brdfs, ivec3(column, at), 0).rgb;
    for (int i = 0; i < N_COMPONENTS; i++)
        one += w[i >> 2][i & 3] * texelFetch(brdfs, ivec3(column + i + 1, at), 0).rgb;
    return one;
}

#if LOG
// Converts c = (ln(Y + ε), (R − Y)/(Y + ε), (B − Y)/(Y + ε)) to R, G, B. Y is the luminance, and ε
// is LOG_OFFSET. c.x is limited to avoid overflow. The limit is brighter than any real material.
vec3 reflectance(vec3 c) {
    float size = exp(min(c.x, 11.0)), y = size - LOG_OFFSET;
    vec2 rb = y + c.yz * size;
    return vec3(rb.x, (y - 0.2126 * rb.x - 0.0722 * rb.y) / 0.7152, rb.y);
}

#if AMBIENT
vec3 sky_of(ivec2 texel, int level) {
    vec3 sum = vec3(0.0);
    for (int a = 0; a < 3; a++)
        sum += g[a] * texelFetch(skies, ivec3(texel, views[a]), level).rgb;
    return ambient * sum;
}
#endif
#else
vec3 reflectance(vec3 c) {
    return c;
}
#endif

vec3 evaluate(int cluster, float share, vec4 w[N_PAGES]) {
    ivec2 row = ivec2(cluster % clusters_a_layer * n_rows, cluster / clusters_a_layer);
    vec3 sum = vec3(0.0);
    for (int a = 0; a < 3; a++) {
#if ALONG
        if (g[a] == 0.0)
            continue;
#endif
        ivec2 at = row + ivec2(views[a], 0);
        for (int b = 0; b < 3; b++)
            sum += g[a] * h[b] * reflectance(one_pair(lights[b], at, share, w));
#if AMBIENT && !LOG
        sum += ambient * g[a] * one_pair(ambient_column, at, share, w);
#endif
    }
    return sum;
}
