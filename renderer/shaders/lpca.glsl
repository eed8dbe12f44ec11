uniform sampler2DArray brdfs;   // x: light · (n_components + 1) + component, y and layer: see row()
uniform sampler2DArray weights; // four components a layer
uniform usampler2D clusters;
uniform usampler2D view_indices;
uniform sampler2D view_weights;
uniform usampler2D light_indices;
uniform sampler2D light_weights;
uniform int n_components;       // without the mean
uniform int n_rows;             // a cluster: the views and their pole
uniform int clusters_a_layer;
uniform int ambient_column;     // a light that is an even sky
uniform bool nearest;

ivec2 row(int cluster, uint view) {
    return ivec2(cluster % clusters_a_layer * n_rows + int(view), cluster / clusters_a_layer);
}

const int MAX_PAGES = 8; // 32 components

vec3 fetch_brdf(int column, ivec2 at) {
    return texelFetch(brdfs, ivec3(column, at), 0).rgb;
}

// Four texels of a tile, and how much of each.
struct patch4 {
    ivec2 texel[4];
    float share[4];
    int cluster[4];
};

// Σ over pairs of g h (E_0 + Σ w_i E_i), i four at a time, in one cluster.
vec3 evaluate(int cluster, vec4 w[MAX_PAGES], uvec4 view, vec4 g, uvec4 light, vec4 h) {
    vec3 sum = vec3(0.0);
    for (int a = 0; a < 4; a++) {
        if (g[a] <= 0.0)
            continue;
        ivec2 at = row(cluster, view[a]);
        for (int b = 0; b < 5; b++) {
            float share = g[a] * (b < 4 ? h[b] : ambient);
            if (share <= 0.0)
                continue;
            int column = (b < 4 ? int(light[b]) : ambient_column) * (n_components + 1);
            vec3 one = fetch_brdf(column, at);
            for (int i = 0; i < n_components; i++)
                one += w[i >> 2][i & 3] * fetch_brdf(column + i + 1, at);
            sum += share * one;
        }
    }
    return sum;
}

// The remainder of a negative integer is undefined.
ivec2 wrapped(ivec2 texel, ivec2 size) {
    return texel - size * ivec2(floor((vec2(texel) + 0.5) / vec2(size)));
}

patch4 patch_at(vec2 x) {
    ivec2 size = textureSize(clusters, 0);
    vec2 place = x * vec2(size) - 0.5, part = nearest ? step(0.5, fract(place)) : fract(place);
    ivec2 corner = ivec2(floor(place));
    patch4 p;
    for (int k = 0; k < 4; k++) {
        ivec2 step = ivec2(k & 1, k >> 1);
        vec2 near = mix(1.0 - part, part, vec2(step));
        p.texel[k] = wrapped(corner + step, size);
        p.share[k] = near.x * near.y;
        p.cluster[k] = int(texelFetch(clusters, p.texel[k], 0).r);
    }
    return p;
}

// See method.h. Within one cluster reflectance is linear in the weights, so that mixing those is
// the same and four times as quick.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    uvec4 view, light;
    vec4 g = direction_shares(view_indices, view_weights, v, view);
    vec4 h = direction_shares(light_indices, light_weights, l, light) * step(0.0, l.z) * lit;
    patch4 p = patch_at(x);
    vec4 w[MAX_PAGES];
    int n_pages = (n_components + 3) / 4, first = p.cluster[0];
    if (p.cluster[1] == first && p.cluster[2] == first && p.cluster[3] == first) {
        for (int page = 0; page < n_pages; page++) {
            w[page] = vec4(0.0);
            for (int k = 0; k < 4; k++)
                w[page] += p.share[k] * texelFetch(weights, ivec3(p.texel[k], page), 0);
        }
        return max(evaluate(first, w, view, g, light, h), vec3(0.0));
    }
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {
        if (p.share[k] <= 0.0)
            continue;
        for (int page = 0; page < n_pages; page++)
            w[page] = texelFetch(weights, ivec3(p.texel[k], page), 0);
        sum += p.share[k] * evaluate(p.cluster[k], w, view, g, light, h);
    }
    return max(sum, vec3(0.0));
}
