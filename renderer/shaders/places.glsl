// Which places of the sample stand at a point of the surface: the one hook through which a codec, the
// MDF and everything else that belongs to a texel is looked up. PLACES 0: the sample is repeated. 1: an
// index map says which texel of the sample stands where; see gl/index_texture.h.
struct places {
    int n;
    vec2 x[4];      // in tiles of the sample
    float share[4]; // of each, 1 together
};

#if PLACES
// Of the point, in tiles: places jump from pixel to pixel, so that their own derivatives mean nothing.
vec2 place_dx, place_dy;
#define PLACE_DX(x)         place_dx
#define PLACE_DY(x)         place_dy
#define PLACE_TEXTURE(s, x) textureGrad(s, x, place_dx, place_dy)
#else
#define PLACE_DX(x)         dFdx(x)
#define PLACE_DY(x)         dFdy(x)
#define PLACE_TEXTURE(s, x) texture(s, x)
#endif

places one_place(vec2 x) {
    places at;
    at.n = 1;
    at.x[0] = x;
    at.share[0] = 1.0;
    return at;
}

#if PLACES == 1
uniform usampler2D index_map;   // all levels, at index_corners
uniform ivec2 index_corners[12]; // INDEX_MAP_LEVELS
uniform ivec2 index_size;
uniform int index_levels;
uniform vec2 index_sample; // texels of the sample

// By how many texels the sample's texel is away from the texel of the map that it stands at; the map
// repeats.
vec2 index_shift(ivec2 texel, int level) {
    ivec2 inside = texel - index_size * ivec2(floor(vec2(texel) / vec2(index_size)));
    inside += index_size * ivec2(lessThan(inside, ivec2(0))); // where the division was rounded
    inside -= index_size * ivec2(greaterThanEqual(inside, index_size));
    ivec2 block = inside >> level;
    ivec2 from = ivec2(texelFetch(index_map, index_corners[level] + block, 0).rg);
    return vec2(from + inside - (block << level) - texel);
}

// Whether texels so shifted continue each other, in a sample that is repeated.
bool index_same(vec2 a, vec2 b) {
    vec2 apart = (a - b) / index_sample;
    return all(lessThan(abs(apart - round(apart)), vec2(1e-4)));
}

void add_place(inout places at, vec2 x, float share) {
    at.x[at.n] = x / index_sample;
    at.share[at.n] = share;
    at.n += share > 0.0 ? 1 : 0;
}

// Two neighbours of a row or column: one place between them, if they are neighbours in the sample, too.
void add_pair(inout places at, vec2 from, vec2 to, float part, vec2 shift_from, vec2 shift_to,
              bool same, float share) {
    if (same) {
        add_place(at, mix(from, to, part) + shift_from, share);
        return;
    }
    add_place(at, from + shift_from, (1.0 - part) * share);
    add_place(at, to + shift_to, part * share);
}

// Level 0 is interpolated between four texels of the map. Those that are neighbours in the sample are
// left to the sample's own filter, so that most points have one place, and those at a seam two to four.
// Of coarser levels, which fit to the pixel, the nearest texel is taken.
places find_places(vec2 x, float level) {
    vec2 p = x * index_sample;
    int whole = clamp(int(level), 0, index_levels - 1);
#if PLACES_NEAREST
    return one_place((p + index_shift(ivec2(floor(p)), 0)) / index_sample);
#endif
    if (whole > 0)
        return one_place((p + index_shift(ivec2(floor(p)), whole)) / index_sample);
    vec2 corner = floor(p - 0.5), part = p - 0.5 - corner, a = corner + 0.5, d = a + 1.0;
    ivec2 texel = ivec2(corner);
    vec2 s00 = index_shift(texel, 0), s10 = index_shift(texel + ivec2(1, 0), 0);
    vec2 s01 = index_shift(texel + ivec2(0, 1), 0), s11 = index_shift(texel + 1, 0);
    bool top = index_same(s00, s10), bottom = index_same(s01, s11);
    bool left = index_same(s00, s01), right = index_same(s10, s11);
    places at;
    at.n = 0;
    if (top && bottom && left) {
        add_place(at, p + s00, 1.0);
    } else if (int(left) + int(right) > int(top) + int(bottom)) {
        add_pair(at, a, vec2(a.x, d.y), part.y, s00, s01, left, 1.0 - part.x);
        add_pair(at, vec2(d.x, a.y), d, part.y, s10, s11, right, part.x);
    } else {
        add_pair(at, a, vec2(d.x, a.y), part.x, s00, s10, top, 1.0 - part.y);
        add_pair(at, vec2(a.x, d.y), d, part.x, s01, s11, bottom, part.y);
    }
    return at;
}
#else
places find_places(vec2 x, float level) {
    return one_place(x);
}
#endif

#if PLACES
// Call it before branches: it takes derivatives.
float prepare_places(vec2 x) {
    place_dx = dFdx(x);
    place_dy = dFdy(x);
    vec2 dx = place_dx * index_sample, dy = place_dy * index_sample;
    return max(0.5 * log2(max(max(dot(dx, dx), dot(dy, dy)), 1e-12)), 0.0);
}
#endif
