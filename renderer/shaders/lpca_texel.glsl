// The texels of a local PCA: which cluster each belongs to, and its weights. What mixes a cluster's
// eigen-BRDFs by them is the method's own.
uniform sampler2DArray weights; // four components a layer
uniform usampler2D clusters;    // of all mip levels, each with its own
uniform int n_levels;
uniform int n_components; // without the mean
uniform bool nearest;

const int MAX_PAGES = 8; // 32 components

// E_0 + Σ w_i E_i of a cluster, for the directions that prepare() was given.
void prepare(vec3 v, vec3 l, float lit);
vec3 evaluate(int cluster, vec4 w[MAX_PAGES]);

// Four texels of a tile, and how much of each.
struct patch4 {
    ivec2 texel[4];
    float share[4];
    int cluster[4];
};

// The remainder of a negative integer is undefined.
ivec2 wrapped(ivec2 texel, ivec2 size) {
    return texel - size * ivec2(floor((vec2(texel) + 0.5) / vec2(size)));
}

patch4 patch_at(vec2 x, int level) {
    ivec2 size = textureSize(clusters, level);
    vec2 place = x * vec2(size) - 0.5, part = nearest ? step(0.5, fract(place)) : fract(place);
    ivec2 corner = ivec2(floor(place));
    patch4 p;
    for (int k = 0; k < 4; k++) {
        ivec2 step = ivec2(k & 1, k >> 1);
        vec2 near = mix(1.0 - part, part, vec2(step));
        p.texel[k] = wrapped(corner + step, size);
        p.share[k] = near.x * near.y;
        p.cluster[k] = int(texelFetch(clusters, p.texel[k], level).r);
    }
    return p;
}

// Within one cluster reflectance is linear in the weights, so that mixing those is the same and four
// times as quick.
vec3 at_level(vec2 x, int level) {
    patch4 p = patch_at(x, level);
    vec4 w[MAX_PAGES];
    int n_pages = (n_components + 3) / 4, first = p.cluster[0];
    if (p.cluster[1] == first && p.cluster[2] == first && p.cluster[3] == first) {
        for (int page = 0; page < n_pages; page++) {
            w[page] = vec4(0.0);
            for (int k = 0; k < 4; k++)
                w[page] += p.share[k] * texelFetch(weights, ivec3(p.texel[k], page), level);
        }
        return max(evaluate(first, w), vec3(0.0));
    }
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {
        if (p.share[k] <= 0.0)
            continue;
        for (int page = 0; page < n_pages; page++)
            w[page] = texelFetch(weights, ivec3(p.texel[k], page), level);
        sum += p.share[k] * evaluate(p.cluster[k], w);
    }
    return max(sum, vec3(0.0));
}

// See method.h. Clusters cannot be filtered: between two levels both are evaluated.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    vec2 size = vec2(textureSize(clusters, 0)), dx = dFdx(x) * size, dy = dFdy(x) * size;
    prepare(v, l, lit);
    if (n_levels == 1 || nearest)
        return at_level(x, 0);
    float most = float(n_levels - 1);
    float level = clamp(0.5 * log2(max(max(dot(dx, dx), dot(dy, dy)), 1e-12)), 0.0, most);
    vec3 fine = at_level(x, int(level));
    float part = fract(level);
    return part > 0.0 ? mix(fine, at_level(x, int(level) + 1), part) : fine;
}
