uniform sampler2DArray maps;
uniform sampler2DArray view_weights;
uniform usampler2D light_indices;
uniform sampler2D light_weights;
uniform int n_terms;
uniform int n_layers; // a term: the lights, the pole, ambient

// BTF(x, v, l) = Σ_i W_i(v) E_i(x, l) (Wang et al. 2005 §5); see method.h. E_i is interpolated between
// up to four measured lights, W_i looked up in a table over the hemisphere.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    vec2 table = vec2(textureSize(view_weights, 0).xy);
    vec2 at = (square(v) * (table - 1.0) + 0.5) / table;
    uvec4 index;
    vec4 share = direction_shares(light_indices, light_weights, l, index) * step(0.0, l.z) * lit;
    vec3 sum = vec3(0.0);
    for (int first = 0; first < n_terms; first += 4) {
        vec4 w = textureLod(view_weights, vec3(at, float(first / 4)), 0.0);
        for (int k = 0; k < min(4, n_terms - first); k++) {
            float base = float((first + k) * n_layers);
            vec3 e = share.x * PLACE_TEXTURE(maps, vec3(x, base + float(index.x))).rgb;
            e += share.y * PLACE_TEXTURE(maps, vec3(x, base + float(index.y))).rgb;
            e += share.z * PLACE_TEXTURE(maps, vec3(x, base + float(index.z))).rgb;
            e += share.w * PLACE_TEXTURE(maps, vec3(x, base + float(index.w))).rgb;
            if (ambient > 0.0)
                e += ambient * PLACE_TEXTURE(maps, vec3(x, base + float(n_layers - 1))).rgb;
            sum += w[k] * e;
        }
    }
    return max(sum, vec3(0.0));
}
