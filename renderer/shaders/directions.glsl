// Returns a direction of the hemisphere as a point of the square [0, 1]²; see directions.h.
vec2 square(vec3 d) {
    d.z = max(d.z, 0.0);
    vec2 p = d.xy / max(abs(d.x) + abs(d.y) + d.z, 1e-6);
    return clamp(0.5 + 0.5 * vec2(p.x + p.y, p.x - p.y), 0.0, 1.0);
}

// Finds at most four measured directions around d, and their weights; see direction_table.h.
// Weights are interpolated bilinearly between cells of the table that have the same four
// directions.
vec4 direction_shares(usampler2D indices, sampler2D weights, vec3 d, out uvec4 index) {
    ivec2 cells = textureSize(indices, 0);
    vec2 place = square(d) * vec2(cells) - 0.5, part = fract(place);
    ivec2 corner = ivec2(floor(place));
    index = texelFetch(indices, min(ivec2(place + 0.5), cells - 1), 0);
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int k = 0; k < 4; k++) {
        ivec2 step = ivec2(k & 1, k >> 1);
        ivec2 cell = clamp(corner + step, ivec2(0), cells - 1);
        vec2 near = mix(1.0 - part, part, vec2(step));
        float share = texelFetch(indices, cell, 0) == index ? near.x * near.y : 0.0;
        sum += share * texelFetch(weights, cell, 0);
        total += share;
    }
    return sum / max(total, 1e-6);
}
