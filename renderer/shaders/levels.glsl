// Returns the mip level of a pixel: a number from 0 to n_levels − 1 that may lie between two
// levels. At this level, a texel is as long as the longer side of the pixel. x is in tiles. A tile
// has size texels.
float mip_level(vec2 x, ivec2 size, int n_levels) {
    vec2 dx = PLACE_DX(x) * vec2(size), dy = PLACE_DY(x) * vec2(size);
    float longest = max(max(dot(dx, dx), dot(dy, dy)), 1e-12);
    return clamp(0.5 * log2(longest), 0.0, float(n_levels - 1));
}
