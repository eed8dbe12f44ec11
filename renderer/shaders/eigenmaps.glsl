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

// Weights between the cells of the table, of those cells that mean the same four layers.
vec4 light_shares(vec2 at, ivec2 cells, uvec4 index) {
    vec2 place = at * vec2(cells) - 0.5, part = fract(place);
    ivec2 corner = ivec2(floor(place));
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int k = 0; k < 4; k++) {
        ivec2 step = ivec2(k & 1, k >> 1);
        ivec2 cell = clamp(corner + step, ivec2(0), cells - 1);
        vec2 near = mix(1.0 - part, part, vec2(step));
        float share = texelFetch(light_indices, cell, 0) == index ? near.x * near.y : 0.0;
        sum += share * texelFetch(light_weights, cell, 0);
        total += share;
    }
    return sum / max(total, 1e-6);
}

// BTF(x, v, l) = Σ_i W_i(v) E_i(x, l); see method.h.
vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    vec2 table = vec2(textureSize(view_weights, 0).xy);
    vec2 at = (square(v) * (table - 1.0) + 0.5) / table;
    ivec2 cells = textureSize(light_indices, 0);
    ivec2 cell = min(ivec2(square(l) * vec2(cells)), cells - 1);
    uvec4 index = texelFetch(light_indices, cell, 0);
    vec4 share = light_shares(square(l), cells, index) * step(0.0, l.z) * lit;
    vec3 sum = vec3(0.0);
    for (int first = 0; first < n_terms; first += 4) {
        vec4 w = textureLod(view_weights, vec3(at, float(first / 4)), 0.0);
        for (int k = 0; k < min(4, n_terms - first); k++) {
            float base = float((first + k) * n_layers);
            vec3 e = share.x * texture(maps, vec3(x, base + float(index.x))).rgb;
            e += share.y * texture(maps, vec3(x, base + float(index.y))).rgb;
            e += share.z * texture(maps, vec3(x, base + float(index.z))).rgb;
            e += share.w * texture(maps, vec3(x, base + float(index.w))).rgb;
            if (ambient > 0.0)
                e += ambient * texture(maps, vec3(x, base + float(n_layers - 1))).rgb;
            sum += w[k] * e;
        }
    }
    return max(sum, vec3(0.0));
}
