uniform sampler2DArray maps;
uniform sampler2DArray view_weights;
uniform usampler2D light_indices;
uniform sampler2D light_weights;
uniform int n_terms;
uniform int n_layers; // a term: the lights, the pole, ambient

// Of the hemisphere, in [0, 1]²; see directions.h.
vec2 square(vec3 d) {
    d.z = max(d.z, 0.0);
    vec2 p = d.xy / max(abs(d.x) + abs(d.y) + d.z, 1e-6);
    return clamp(0.5 + 0.5 * vec2(p.x + p.y, p.x - p.y), 0.0, 1.0);
}

// BTF(x, v, l) = Σ_i W_i(v) E_i(x, l); v and l unit vectors in the frame of the texture.
vec3 btf(vec2 x, vec3 v, vec3 l) {
    vec2 table = vec2(textureSize(view_weights, 0).xy);
    vec2 at = (square(v) * (table - 1.0) + 0.5) / table;
    ivec2 cells = textureSize(light_indices, 0);
    ivec2 cell = min(ivec2(square(l) * vec2(cells)), cells - 1);
    vec4 index = vec4(texelFetch(light_indices, cell, 0));
    vec4 share = texelFetch(light_weights, cell, 0) * step(0.0, l.z);
    vec3 sum = vec3(0.0);
    for (int first = 0; first < n_terms; first += 4) {
        vec4 w = textureLod(view_weights, vec3(at, float(first / 4)), 0.0);
        for (int k = 0; k < min(4, n_terms - first); k++) {
            float base = float((first + k) * n_layers);
            vec3 e = ambient * texture(maps, vec3(x, base + float(n_layers - 1))).rgb;
            e += share.x * texture(maps, vec3(x, base + index.x)).rgb;
            e += share.y * texture(maps, vec3(x, base + index.y)).rgb;
            e += share.z * texture(maps, vec3(x, base + index.z)).rgb;
            e += share.w * texture(maps, vec3(x, base + index.w)).rgb;
            sum += w[k] * e;
        }
    }
    return max(sum, vec3(0.0));
}
