uniform sampler2DArray maps;
uniform sampler2DArray view_weights;
uniform usampler2D light_indices;
uniform sampler2D light_weights;
uniform int n_terms;
uniform int n_layers; // layers of a term: one for each light, one for the pole, one for an even sky

#define BTF_PREPARED
vec2 view_at; // coordinates of the view in the table of W_i
uvec4 light_index;
vec4 light_share;

void btf_prepare(vec3 v, vec3 l, float lit) {
    vec2 table = vec2(textureSize(view_weights, 0).xy);
    view_at = (square(v) * (table - 1.0) + 0.5) / table;
    light_share =
        direction_shares(light_indices, light_weights, l, light_index) * step(0.0, l.z) * lit;
}

// BTF(x, v, l) = Σ_i W_i(v) E_i(x, l) (Wang et al. 2005 §5); see method.h. The eigen-maps E_i are
// interpolated between up to four measured lights. The weights W_i are read from a table over the
// hemisphere.
vec3 btf_texel(vec2 x) {
    vec3 sum = vec3(0.0);
    for (int first = 0; first < n_terms; first += 4) {
        vec4 w = textureLod(view_weights, vec3(view_at, float(first / 4)), 0.0);
        for (int k = 0; k < min(4, n_terms - first); k++) {
            float base = float((first + k) * n_layers);
            vec3 e = light_share.x * PLACE_TEXTURE(maps, vec3(x, base + float(light_index.x))).rgb;
            e += light_share.y * PLACE_TEXTURE(maps, vec3(x, base + float(light_index.y))).rgb;
            e += light_share.z * PLACE_TEXTURE(maps, vec3(x, base + float(light_index.z))).rgb;
            e += light_share.w * PLACE_TEXTURE(maps, vec3(x, base + float(light_index.w))).rgb;
            if (ambient > 0.0)
                e += ambient * PLACE_TEXTURE(maps, vec3(x, base + float(n_layers - 1))).rgb;
            sum += w[k] * e;
        }
    }
    return max(sum, vec3(0.0));
}

vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    btf_prepare(v, l, lit);
    return btf_texel(x);
}
