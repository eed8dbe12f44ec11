// The places of the sample that a point of the surface shows. Codecs, the MDF and everything else
// that belongs to a texel are looked up at these places.
// - PLACES 0: the sample is repeated.
// - PLACES 1: an index map gives the texel of the sample for each texel of the surface; see
//   gl/index_texture.h.
// - PLACES 2: hexagons show parts of the sample, endlessly; see synthesis/endless.h.
struct places {
    int n;
    vec2 x[4];      // in tiles of the sample; with hexagons, x[0] is in the nearest hexagon
    float share[4]; // weight of each place; the sum of the weights is 1
    int mean;       // index of the place that stands for the sample's mean; −1 if there is none
};

#if PLACES || CURVED
// Derivatives of the surface point, in tiles. They are computed here, because places and the ends
// of rays (curved.glsl) jump from pixel to pixel, so that their derivatives would be meaningless.
vec2 place_dx, place_dy;
#define PLACE_DX(x) place_dx
#define PLACE_DY(x) place_dy
#if PLACES_LEVEL
// The mip level, for llvmpipe. llvmpipe takes longer for look-ups with explicit derivatives. A
// level that is within a quarter of an integer is rounded to this integer, so that one mip level is
// read instead of two. llvmpipe does the same when it computes derivatives itself.
float place_level(vec2 size) {
    vec2 dx = place_dx * size, dy = place_dy * size;
    float level = 0.5 * log2(max(max(dot(dx, dx), dot(dy, dy)), 1e-12)), whole = floor(level);
    return whole + clamp(2.0 * (level - whole) - 0.5, 0.0, 1.0);
}
#define PLACE_TEXTURE(s, x) textureLod(s, x, place_level(vec2(textureSize(s, 0).xy)))
#else
#define PLACE_TEXTURE(s, x) textureGrad(s, x, place_dx, place_dy)
#endif
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
    at.mean = -1;
    return at;
}

#if PLACES == 1
uniform usampler2D index_map;    // all mip levels, with their first texels at index_corners
uniform ivec2 index_corners[12]; // INDEX_MAP_LEVELS elements
uniform ivec2 index_size;
uniform int index_levels;
uniform vec2 index_sample; // size of the sample in texels

// Returns the offset, in texels, from a texel of the map to the texel of the sample that it names.
// The map repeats.
vec2 index_shift(ivec2 texel, int level) {
    ivec2 inside = texel - index_size * ivec2(floor(vec2(texel) / vec2(index_size)));
    inside +=
        index_size * ivec2(lessThan(inside, ivec2(0))); // because the division rounds towards zero
    inside -= index_size * ivec2(greaterThanEqual(inside, index_size));
    ivec2 block = inside >> level;
    ivec2 from = ivec2(texelFetch(index_map, index_corners[level] + block, 0).rg);
    return vec2(from + inside - (block << level) - texel);
}

// Returns whether two neighbouring texels of the map are also neighbours in the repeated sample. a
// and b are the results of index_shift() for these texels.
bool index_same(vec2 a, vec2 b) {
    vec2 apart = (a - b) / index_sample;
    return all(lessThan(abs(apart - round(apart)), vec2(1e-4)));
}

void add_place(inout places at, vec2 x, float share) {
    at.x[at.n] = x / index_sample;
    at.share[at.n] = share;
    at.n += share > 0.0 ? 1 : 0;
}

// Adds the places of two neighbouring texels of a row or column of the map. If the two texels are
// also neighbours in the sample (same), one place between them is added.
void add_pair(inout places at, vec2 from, vec2 to, float part, vec2 shift_from, vec2 shift_to,
              bool same, float share) {
    if (same) {
        add_place(at, mix(from, to, part) + shift_from, share);
        return;
    }
    add_place(at, from + shift_from, (1.0 - part) * share);
    add_place(at, to + shift_to, part * share);
}

// Finds the places of a point. At level 0, four texels of the map are interpolated. If some of
// these texels are also neighbours in the sample, they become one place, and the sample's own
// filter interpolates between them. Most points therefore have one place. Points at a seam have two
// to four places. At coarser levels, a texel of the map is as large as the pixel, so only the
// nearest texel is used.
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
    at.mean = -1;
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
#elif PLACES == 2
#ifdef N_LEVELS // only for a method with mip levels in its file
#define ENDLESS_MEAN (N_LEVELS > 1)
#else
#define ENDLESS_MEAN 1
#endif
uniform vec2 endless_cells; // columns and rows of hexagons per tile
uniform ivec2
    endless_period; // columns and rows after which the hexagons repeat; the number of rows is even
uniform vec2 endless_edge;                     // half a texel, in tiles
uniform vec2 endless_centres[ENDLESS_CENTRES]; // centres of hexagons in the sample, in tiles

// Computes the same as endless_hash() of synthesis/endless.h.
uint endless_hash(uvec2 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * 1664525u;
    v.y += v.x * 1664525u;
    v ^= v >> 16u;
    v.x += v.y * 1664525u;
    return v.x ^ (v.x >> 16u);
}

int endless_turns(int a, int b) {
    return int(floor((float(a) + 0.5) / float(b)));
}

// Returns where a point lies in the sample, if the hexagon around a vertex shows the point.
vec2 endless_look_up(vec2 x, ivec2 vertex) {
    int turn = endless_turns(vertex.y, endless_period.y);
    ivec2 inside = vertex + turn * ivec2(endless_period.y / 2, -endless_period.y);
    inside.x -= endless_period.x * endless_turns(inside.x, endless_period.x);
    uint hash = endless_hash(uvec2(inside));
    vec2 centre = vec2(float(vertex.x) + 0.5 * float(vertex.y), float(vertex.y)) / endless_cells;
    vec2 at = x - centre + endless_centres[hash & uint(ENDLESS_CENTRES - 1)];
    return clamp(at, endless_edge, 1.0 - endless_edge);
}

// Finds the three vertices of the triangle around a point, the nearest vertex first. near is how
// close the point is to each vertex, as barycentric weights.
void endless_triangle(vec2 x, out ivec2 vertices[3], out vec3 near) {
    vec2 q = x * endless_cells, p = vec2(q.x - 0.5 * q.y, q.y), base = floor(p), f = p - base;
    int far = f.x + f.y > 1.0 ? 1 : 0;
    near = far == 1 ? vec3(f.x + f.y - 1.0, 1.0 - f.yx) : vec3(1.0 - f.x - f.y, f);
    vertices[0] = ivec2(base) + far;
    vertices[1] = ivec2(base) + ivec2(1, 0);
    vertices[2] = ivec2(base) + ivec2(0, 1);
    int first = near.y > max(near.x, near.z) ? 1 : near.z > near.x ? 2 : 0;
    ivec2 other = vertices[first];
    vertices[first] = vertices[0];
    vertices[0] = other;
    near = first == 1 ? near.yxz : first == 2 ? near.zyx : near;
}

// Returns only the place in the nearest hexagon.
places nearest_place(vec2 x) {
    ivec2 vertices[3];
    vec3 near;
    endless_triangle(x, vertices, near);
    return one_place(endless_look_up(x, vertices[0]));
}

// Finds the places of a point in up to three hexagons. Where hexagons blend, there is a further
// place, the last one, which stands for the mean of the sample (ENDLESS_MEAN).
places find_places(vec2 x, float level) {
#if PLACES_NEAREST
    return nearest_place(x);
#endif
    ivec2 vertices[3];
    vec3 near;
    endless_triangle(x, vertices, near);
    vec3 share = max(near - near.x + ENDLESS_BLEND, 0.0);
#if ENDLESS_MEAN
    share /= length(share);
#else
    share /= dot(share, vec3(1.0));
#endif
    places at = one_place(endless_look_up(x, vertices[0]));
    at.share[0] = share.x;
    for (int k = 1; k < 3; k++)
        if (share[k] > 0.0) {
            at.x[at.n] = endless_look_up(x, vertices[k]);
            at.share[at.n++] = share[k];
        }
#if ENDLESS_MEAN
    if (at.n > 1) {
        at.mean = at.n;
        at.x[at.n] = at.x[0];
        at.share[at.n++] = 1.0 - dot(share, vec3(1.0));
    }
#endif
    return at;
}
#else
places find_places(vec2 x, float level) {
    return one_place(x);
}
#endif

// Sets place_dx and place_dy, and returns the mip level of the index map. Call this function before
// branches, because it takes derivatives.
float prepare_places(vec2 x) {
#if PLACES || CURVED
    place_dx = dFdx(x);
    place_dy = dFdy(x);
#endif
#if PLACES != 1
    return 0.0;
#else
    vec2 dx = place_dx * index_sample, dy = place_dy * index_sample;
    return max(0.5 * log2(max(max(dot(dx, dx), dot(dy, dy)), 1e-12)), 0.0);
#endif
}

#if PLACES || CURVED
// From now on, PLACE_TEXTURE() returns the mean of the sample, from its coarsest mip level.
void prepare_mean() {
    place_dx = vec2(1e4, 0.0);
    place_dy = vec2(0.0, 1e4);
}
#endif
