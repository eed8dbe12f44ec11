// Analytic models of texels; see lobes_view.h. N_LEVELS, NEAREST, SLICED, N_LOBES and ROTATION are
// constants. If SLICED is 1, there is one slice for each view. If it is 0, there is one for all
// views.
uniform sampler2DArray values; // layer: slice · n_pages + page
uniform sampler2DArray
    ambients; // reflectance under an even sky: a layer per view, and one for the pole
uniform usampler2D view_indices;
uniform sampler2D view_weights;
uniform usampler2D pole; // indices of the views in the mean that stands for the pole
uniform int n_pages;
uniform int n_slices;

int mip = 0; // the mip level that is evaluated

vec4 page(ivec2 texel, int slice, int number) {
    return texelFetch(values, ivec3(texel, slice * n_pages + number), mip);
}

// Returns the reflectance of a texel. Each model defines it (fields.glsl, ptm.glsl, lafortune.glsl,
// facets.glsl).
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l);

float lobe(vec4 xyzn, vec3 w) {
    float c = dot(xyzn.xyz, w);
    return c > 0.0 ? pow(c, xyzn.w) : 0.0;
}

// Returns the reflectance of a texel in a slice. If slice is n_slices, returns the mean of the
// views that stand for the pole. The result is clamped to 0, because polynomials may be negative.
vec3 slice_at(ivec2 texel, int slice, vec3 v, vec3 l) {
#if SLICED
    if (slice >= n_slices) {
        int n = textureSize(pole, 0).x;
        vec3 sum = vec3(0.0);
        for (int k = 0; k < n; k++)
            sum +=
                max(reflectance(texel, int(texelFetch(pole, ivec2(k, 0), 0).r), v, l), vec3(0.0));
        return sum / float(n);
    }
#endif
    return max(reflectance(texel, slice, v, l), vec3(0.0));
}

vec3 texel_at(ivec2 texel, uvec4 views, vec4 g, vec3 v, vec3 l, float lit) {
    vec3 sum = vec3(0.0);
#if !SLICED
    if (lit > 0.0)
        sum = lit * slice_at(texel, 0, v, l);
#endif
#if SLICED || AMBIENT
    for (int a = 0; a < 4; a++) {
        if (g[a] <= 0.0)
            continue;
#if SLICED
        if (lit > 0.0)
            sum += lit * g[a] * slice_at(texel, int(views[a]), v, l);
#endif
#if AMBIENT
        sum += ambient * g[a] * texelFetch(ambients, ivec3(texel, int(views[a])), mip).rgb;
#endif
    }
#endif
    return sum;
}

vec3 at_level(vec2 x, uvec4 views, vec4 g, vec3 v, vec3 l, float lit) {
    ivec2 size = textureSize(values, mip).xy;
    vec2 place = x * vec2(size) - 0.5, corner = floor(place), part = place - corner;
#if NEAREST
    part = step(0.5, part);
#endif
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {
        vec2 one = vec2(k & 1, k >> 1), near = mix(1.0 - part, part, one);
        if (near.x * near.y <= 0.0)
            continue;
        vec2 at = corner + one;
        ivec2 texel = ivec2(at - vec2(size) * floor((at + 0.5) / vec2(size)));
        sum += near.x * near.y * texel_at(texel, views, g, v, l, lit);
    }
    return sum;
}

// See method.h. Parameters of a model cannot be filtered. The reflectances of both mip levels are
// mixed instead.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    uvec4 views = uvec4(0u);
    vec4 g = vec4(0.0);
#if SLICED || AMBIENT
    g = direction_shares(view_indices, view_weights, v, views);
#endif
    lit *= step(0.0, l.z);
#if NEAREST || N_LEVELS == 1
    return at_level(x, views, g, v, l, lit);
#else
    float level = mip_level(x, textureSize(values, 0).xy, N_LEVELS), part = fract(level);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 2; k++) {
        mip = int(level) + k;
        sum += (k == 0 ? 1.0 - part : part) * at_level(x, views, g, v, l, lit);
        if (part <= 0.0)
            break;
    }
    return sum;
#endif
}
