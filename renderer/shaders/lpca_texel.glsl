// The texels of a local PCA: the cluster and the weights of each. Each method mixes the eigen-BRDFs
// of a cluster by these weights in a different way. N_COMPONENTS (without the mean), N_LEVELS,
// NEAREST and LOG (logarithms are mixed, see lpca.h) are constants; see lpca_texels.h.
uniform sampler2DArray weights; // four components per layer
// clusters of four texels: this texel, the texel to the right, the texel below, and the texel below
// and to the right
uniform usampler2D clusters;

const int N_PAGES = (N_COMPONENTS + 3) / 4;

// evaluate() returns the value of a cluster, share · E_0 + Σ w_i E_i, in the directions that were
// passed to prepare().
void prepare(vec3 v, vec3 l, float lit);
vec3 evaluate(int cluster, float share, vec4 w[N_PAGES]);

#if LOG && AMBIENT
// Returns the reflectance of a texel under the even sky. With logarithms, this reflectance is not
// linear in the weights, so it has its own texture. Without logarithms, evaluate() includes the
// sky, and this function returns 0.
vec3 sky_of(ivec2 texel, int level);
#else
vec3 sky_of(ivec2 texel, int level) {
    return vec3(0.0);
}
#endif

vec3 one_texel(vec2 x, int level) {
    ivec2 size = textureSize(clusters, level);
    ivec2 texel = min(ivec2(fract(x) * vec2(size)), size - 1);
    vec4 w[N_PAGES];
    for (int page = 0; page < N_PAGES; page++)
        w[page] = texelFetch(weights, ivec3(texel, page), level);
    int cluster = int(texelFetch(clusters, texel, level).r);
    return max(evaluate(cluster, 1.0, w) + sky_of(texel, level), vec3(0.0));
}

// Interpolates the reflectance bilinearly between the four texels around x. Usually all four texels
// have the same cluster. Within one cluster, reflectance is linear in the weights, so the weights
// of its texels are mixed, and the cluster is evaluated once. With logarithms, each texel is
// evaluated.
vec3 at_level(vec2 x, int level) {
    ivec2 size = textureSize(clusters, level);
    vec2 place = fract(x) * vec2(size) - 0.5, corner = floor(place), part = place - corner;
    ivec2 a = ivec2(corner);
    a += size * ivec2(lessThan(a, ivec2(0)));
    ivec2 b = a + 1 - size * ivec2(equal(a, size - 1));
    uvec4 cluster = texelFetch(clusters, a, level);
    vec2 near = 1.0 - part;
    vec4 share = vec4(near.x, part.x, near.x, part.x) * vec4(near.yy, part.yy);
    vec4 w[N_PAGES], all[4 * N_PAGES];
    for (int page = 0; page < N_PAGES; page++) {
        all[4 * page] = texelFetch(weights, ivec3(a, page), level);
        all[4 * page + 1] = texelFetch(weights, ivec3(b.x, a.y, page), level);
        all[4 * page + 2] = texelFetch(weights, ivec3(a.x, b.y, page), level);
        all[4 * page + 3] = texelFetch(weights, ivec3(b, page), level);
    }
    vec3 sum = vec3(0.0);
#if LOG
    for (int k = 0; k < 4; k++) {
        if (share[k] <= 0.0)
            continue;
        for (int page = 0; page < N_PAGES; page++)
            w[page] = all[4 * page + k];
        ivec2 texel = ivec2((k & 1) == 0 ? a.x : b.x, k < 2 ? a.y : b.y);
        sum += share[k] * (evaluate(int(cluster[k]), 1.0, w) + sky_of(texel, level));
    }
#else
    for (int k = 0; k < 4; k++) {
        uint one = share.x > 0.0   ? cluster.x
                   : share.y > 0.0 ? cluster.y
                   : share.z > 0.0 ? cluster.z
                                   : cluster.w;
        vec4 mine = share * vec4(equal(cluster, uvec4(one)));
        share -= mine;
        for (int page = 0; page < N_PAGES; page++)
            w[page] = mine.x * all[4 * page] + mine.y * all[4 * page + 1] +
                      mine.z * all[4 * page + 2] + mine.w * all[4 * page + 3];
        sum += evaluate(int(one), dot(mine, vec4(1.0)), w);
        if (dot(share, vec4(1.0)) <= 0.0)
            break;
    }
#endif
    return max(sum, vec3(0.0));
}

#define BTF_PREPARED
void btf_prepare(vec3 v, vec3 l, float lit) {
    prepare(v, l, lit);
}

// See method.h. Clusters cannot be filtered. Between two mip levels, both levels are therefore
// evaluated, and the results are interpolated.
vec3 btf_texel(vec2 x) {
#if NEAREST
    return one_texel(x, 0);
#elif N_LEVELS == 1
    return at_level(x, 0);
#else
    // There is no loop here, because llvmpipe fetches all four pixels of a quad at the level of the
    // first pixel. In a loop, the first pixel may have stopped before the others.
    float level = mip_level(x, textureSize(clusters, 0), N_LEVELS), part = fract(level);
    vec3 sum = (1.0 - part) * at_level(x, int(level));
    if (part > 0.0)
        sum += part * at_level(x, int(level) + 1);
    return sum;
#endif
}

vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    btf_prepare(v, l, lit);
    return btf_texel(x);
}
