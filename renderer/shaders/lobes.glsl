// Analytic models of texels; see lobes_view.h.
uniform sampler2DArray values;   // slice · n_pages + page
uniform sampler2DArray ambients; // under an even sky, a layer a view and one of their pole
uniform usampler2D view_indices;
uniform sampler2D view_weights;
uniform usampler2D pole; // which views the pole is the mean of
uniform int n_pages;
uniform int n_slices; // one a view, or one for all
uniform int n_lobes;
uniform int rotation;
uniform bool nearest;

vec4 page(ivec2 texel, int slice, int number) {
    return texelFetch(values, ivec3(texel, slice * n_pages + number), 0);
}

// Reflectance; the model's own.
vec3 reflectance(ivec2 texel, int slice, vec3 v, vec3 l);

float lobe(vec4 xyzn, vec3 w) {
    float c = dot(xyzn.xyz, w);
    return c > 0.0 ? pow(c, xyzn.w) : 0.0;
}

// Polynomials may be negative.
vec3 slice_at(ivec2 texel, int slice, vec3 v, vec3 l) {
    if (slice < n_slices)
        return max(reflectance(texel, slice, v, l), vec3(0.0));
    int n = textureSize(pole, 0).x;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < n; k++)
        sum += max(reflectance(texel, int(texelFetch(pole, ivec2(k, 0), 0).r), v, l), vec3(0.0));
    return sum / float(n);
}

vec3 texel_at(ivec2 texel, uvec4 views, vec4 g, vec3 v, vec3 l, float lit) {
    vec3 sum = vec3(0.0);
    if (lit > 0.0 && n_slices == 1)
        sum = lit * slice_at(texel, 0, v, l);
    for (int a = 0; a < 4; a++) {
        if (g[a] <= 0.0)
            continue;
        if (lit > 0.0 && n_slices > 1)
            sum += lit * g[a] * slice_at(texel, int(views[a]), v, l);
        if (ambient > 0.0)
            sum += ambient * g[a] * texelFetch(ambients, ivec3(texel, int(views[a])), 0).rgb;
    }
    return sum;
}

// See method.h.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    ivec2 size = textureSize(values, 0).xy;
    vec2 place = x * vec2(size) - 0.5, part = nearest ? step(0.5, fract(place)) : fract(place);
    vec2 corner = floor(place);
    uvec4 views;
    vec4 g = direction_shares(view_indices, view_weights, v, views);
    lit *= step(0.0, l.z);
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
