// Eigen-BRDFs over a grid of the hemisphere's square, for views and for lights; see lpca_grid.h.
uniform usamplerBuffer brdfs; // N_PAGES texels per sample
// samples in each direction; the light with the index n_grid² is an even sky
uniform int n_grid;

// The corners of the simplex around (v, l), as indices within a cluster, and their weights.
int corners[5];
float shares[5];
// For the even sky: the corners of the triangle around v, and their weights times ambient.
int sky_corners[3];
float sky_shares[3];

// Sorts two fractions in descending order. step_a and step_b are the address steps along their
// coordinates, and are exchanged with the fractions.
void order(inout float a, inout float b, inout int step_a, inout int step_b) {
    bool swap = a < b;
    float less = min(a, b);
    int other = swap ? step_a : step_b;
    step_a = swap ? step_b : step_a;
    step_b = other;
    a = max(a, b);
    b = less;
}

// Finds the simplex that contains (v, l), in a cell of the 4D grid. The first corner of the simplex
// is the first corner of the cell. Each further corner is one step along a coordinate from the
// corner before. The coordinates are taken in descending order of the fractions r_1 ≥ r_2 ≥ r_3 ≥
// r_4 of (v, l) within the cell. The weights of the corners are 1 − r_1, r_1 − r_2, …, r_4.
void prepare(vec3 v, vec3 l, float lit) {
    vec4 place = vec4(square(v), square(l)) * float(n_grid - 1);
    vec4 base = min(floor(place), float(n_grid - 2)), r = place - base;
    ivec4 cell = ivec4(base), steps = ivec4(0, n_grid * n_grid + 1, n_grid, 1);
    steps.x = steps.y * n_grid;
    int first = (cell.x * n_grid + cell.y) * steps.y;
#if AMBIENT
    bool steep = r.x >= r.y;
    sky_corners[0] = first + n_grid * n_grid;
    sky_corners[1] = sky_corners[0] + (steep ? steps.x : steps.y);
    sky_corners[2] = sky_corners[0] + steps.x + steps.y;
    sky_shares[0] = ambient * (1.0 - max(r.x, r.y));
    sky_shares[1] = ambient * abs(r.x - r.y);
    sky_shares[2] = ambient * min(r.x, r.y);
#endif
    order(r.x, r.y, steps.x, steps.y);
    order(r.z, r.w, steps.z, steps.w);
    order(r.x, r.z, steps.x, steps.z);
    order(r.y, r.w, steps.y, steps.w);
    order(r.y, r.z, steps.y, steps.z);
    corners[0] = first + cell.z * n_grid + cell.w;
    for (int k = 0; k < 4; k++)
        corners[k + 1] = corners[k] + steps[k];
    lit *= step(0.0, l.z);
    shares[0] = lit * (1.0 - r.x);
    shares[1] = lit * (r.x - r.y);
    shares[2] = lit * (r.y - r.z);
    shares[3] = lit * (r.z - r.w);
    shares[4] = lit * r.w;
}

// Decodes the mean E_0: nine bits per colour and a common exponent, as GL_RGB9_E5.
vec3 mean_of(uint word) {
    vec3 steps = vec3(word & 511u, (word >> 9) & 511u, (word >> 18) & 511u);
    return steps * uintBitsToFloat(((word >> 27) + 103u) << 23);
}

vec4 bytes_of(uint word) {
    return vec4(ivec4(int(word << 24), int(word << 16), int(word << 8), int(word)) >> 24);
}

vec3 sample_at(int at, float share, vec4 w[N_PAGES]) {
    uvec4 words = texelFetch(brdfs, at);
    vec3 sum = share * mean_of(words.x);
    sum += vec3(dot(w[0], bytes_of(words.y)), dot(w[0], bytes_of(words.z)),
                dot(w[0], bytes_of(words.w)));
    for (int page = 1; page < N_PAGES; page++) {
        words = texelFetch(brdfs, at + page);
        sum += vec3(dot(w[page], bytes_of(words.y)), dot(w[page], bytes_of(words.z)),
                    dot(w[page], bytes_of(words.w)));
    }
    return sum;
}

vec3 evaluate(int cluster, float share, vec4 w[N_PAGES]) {
    int cells = n_grid * n_grid, first = cluster * cells * (cells + 1);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 5; k++)
        sum += shares[k] * sample_at((first + corners[k]) * N_PAGES, share, w);
#if AMBIENT
    for (int k = 0; k < 3; k++)
        sum += sky_shares[k] * sample_at((first + sky_corners[k]) * N_PAGES, share, w);
#endif
    return sum;
}
