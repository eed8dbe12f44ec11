/* Where rays end on the height map, and what the map says of the light there: steps 1 to 3 of
 * neural.h. The four rays of two samples are in the lanes of vectors. As in neural_layers.c, the
 * functions are compiled for processors with AVX2 and for others. */
#include "neural_private.h"

#include "codecs/lobes/lobes_lanes.h"

#include <math.h>
#include <string.h>

#define SUBRAY    0.25F  /* of a texel, from the centre */
#define MIN_UP    0.05F  /* least v.z and least r of a reach */
#define MIN_FLAT  1e-4F  /* least |(l.x, l.y)| */
#define SLOPE_END 0.375F /* half the length over which a slope is taken, in texels */
#define FIRST     0.375F /* first distance of the scan of the horizon, in texels */
#define STEP      0.25F  /* half a cell */

G_STATIC_ASSERT(LANES == 2 * NEURAL_RAYS);

void neural_taps(float u, float v, int columns, int rows, struct neural_taps *ret) {
    const float x = CLAMP(u * (float)columns - 0.5F, 0, (float)(columns - 1));
    const float y = CLAMP(v * (float)rows - 0.5F, 0, (float)(rows - 1));
    const int i = (int)x, j = (int)y;
    const int right = i + 1 < columns, down = j + 1 < rows ? columns : 0;
    const float a = x - (float)i, b = y - (float)j;
    ret->at[0] = j * columns + i;
    ret->at[1] = ret->at[0] + right;
    ret->at[2] = ret->at[0] + down;
    ret->at[3] = ret->at[2] + right;
    ret->weight[0] = (1 - a) * (1 - b);
    ret->weight[1] = a * (1 - b);
    ret->weight[2] = (1 - a) * b;
    ret->weight[3] = a * b;
}

/* Converts coordinates of cells to the first of two cells and the share of the second one. */
LANES_INLINE lane_bits find_cells(lanes at, int n, lanes *ret_share) {
    const lanes inside = lanes_min(lanes_max(at, lanes_all(0)), lanes_all((float)(n - 1)));
    const lane_bits first = __builtin_convertvector(inside, lane_bits);
    const lane_bits last = first < n - 1;
    const lane_bits cell = (last & first) | (~last & (n - 2));
    *ret_share = inside - __builtin_convertvector(cell, lanes);
    return cell;
}

LANES_INLINE lanes gather(const float *from, lane_bits at) {
    return (lanes){from[at[0]], from[at[1]], from[at[2]], from[at[3]],
                   from[at[4]], from[at[5]], from[at[6]], from[at[7]]};
}

/* H(x, y): the heights at places in texels. The map has at least 2 × 2 cells. */
LANES_INLINE lanes heights_at(const struct neural_numbers *numbers, lanes x, lanes y) {
    const int columns = 2 * numbers->width, rows = 2 * numbers->height;
    lanes a, b;
    const lane_bits i = find_cells(2 * x - 0.5F, columns, &a);
    const lane_bits at = find_cells(2 * y - 0.5F, rows, &b) * columns + i;
    const float *z = numbers->heights;
    const lanes left = gather(z, at), left_below = gather(z + columns, at);
    const lanes above = left + a * (gather(z + 1, at) - left);
    const lanes below = left_below + a * (gather(z + columns + 1, at) - left_below);
    return above + b * (below - above);
}

LANES_INLINE gboolean any(lane_bits bits) {
    gint64 halves[LANES / 2];
    memcpy(halves, &bits, sizeof halves);
    return (halves[0] | halves[1] | halves[2] | halves[3]) != 0;
}

/* Moves x and y, where rays meet the reference plane, to the ends of the rays. wx and wy are w, and
 * n the number of steps. */
LANES_INLINE void find_ends(const struct neural_numbers *numbers, lanes *x, lanes *y, lanes wx,
                            lanes wy, lanes n) {
    const float range = numbers->top - numbers->bottom;
    lanes above = lanes_all(numbers->top), below = above;
    lane_bits going = n >= 0;
    for (lanes k = lanes_all(0); any(going &= k <= n); k += 1) {
        const lanes z = numbers->top - range * k / n;
        above = lanes_if(going, below, above);
        below = lanes_if(going, z, below);
        going &= heights_at(numbers, *x + wx * z, *y + wy * z) < z;
    }
    for (int k = 0; k < NEURAL_HALVINGS; k++) {
        const lanes z = 0.5F * (above + below);
        const lane_bits under = heights_at(numbers, *x + wx * z, *y + wy * z) >= z;
        below = lanes_if(under, z, below);
        above = lanes_if(under, above, z);
    }
    *x += wx * below;
    *y += wy * below;
}

/* Returns h of step 2: the slopes of the horizon at (x, y) towards (dx, dy), at least r − 1. */
LANES_INLINE lanes find_horizons(const struct neural_numbers *numbers, lanes x, lanes y, lanes dx,
                                 lanes dy, lanes r) {
    const lanes z = heights_at(numbers, x, y), room = numbers->top - z;
    const lanes reach = (numbers->top - numbers->bottom) / lanes_max(r, lanes_all(MIN_UP)) + 0.5F;
    lanes h = r - 1, t = lanes_all(FIRST);
    for (int k = 0; k < NEURAL_MAX_STEPS; k++) {
        const lane_bits going = (t <= reach) & (room > h * t);
        if (!any(going))
            break;
        const lanes there = heights_at(numbers, x + dx * t, y + dy * t);
        h = lanes_if(going, lanes_max(h, (there - z) / t), h);
        t = lanes_if(going, t + lanes_max(lanes_all(STEP), t / 16), t);
    }
    return h;
}

/* N · l, where N is the normal of the map at (x, y). */
LANES_INLINE lanes find_cosines(const struct neural_numbers *numbers, lanes x, lanes y,
                                const lanes light[3]) {
    const float e = SLOPE_END;
    const lanes right_down = heights_at(numbers, x + e, y + e);
    const lanes right_up = heights_at(numbers, x + e, y - e);
    const lanes left_down = heights_at(numbers, x - e, y + e);
    const lanes left_up = heights_at(numbers, x - e, y - e);
    const lanes s = (right_down + right_up - left_down - left_up) / (4 * e);
    const lanes t = (right_down + left_down - right_up - left_up) / (4 * e);
    return (light[2] - s * light[0] + t * light[1]) / lanes_sqrt(s * s + t * t + 1);
}

/* Finds the ends of the rays of two samples. */
LANES_INLINE void find_ends_of_two(const struct neural_numbers *numbers,
                                   const struct neural_sample *const samples[2],
                                   struct neural_ends *const ret[2]) {
    lanes x = {0}, y = {0}, wx = {0}, wy = {0}, n = {0};
    for (int k = 0; k < LANES; k++) {
        const struct neural_sample *sample = samples[k / NEURAL_RAYS];
        const float up = MAX(sample->view[2], MIN_UP);
        x[k] = sample->x + (k & 1 ? SUBRAY : -SUBRAY);
        y[k] = sample->y + (k & 2 ? SUBRAY : -SUBRAY);
        wx[k] = sample->view[0] / up;
        wy[k] = -sample->view[1] / up;
        const float slope = MAX(1, sqrtf(wx[k] * wx[k] + wy[k] * wy[k]));
        n[k] = CLAMP(ceilf(4 * (numbers->top - numbers->bottom) * slope), 1, NEURAL_MAX_STEPS);
    }
    find_ends(numbers, &x, &y, wx, wy, n);
    for (int k = 0; k < LANES; k++) {
        ret[k / NEURAL_RAYS]->x[k % NEURAL_RAYS] = x[k];
        ret[k / NEURAL_RAYS]->y[k % NEURAL_RAYS] = y[k];
    }
}

/* Finds shade, lit and clear of two samples, whose ends are in their queries. */
LANES_INLINE void find_light_of_two(const struct neural_numbers *numbers,
                                    const struct neural_sample *const samples[2],
                                    struct neural_query *const ret[2]) {
    lanes x = {0}, y = {0}, dx = {0}, dy = {0}, r = {0}, light[3] = {{0}};
    for (int k = 0; k < LANES; k++) {
        const float *l = samples[k / NEURAL_RAYS]->light;
        const float flat = MAX(sqrtf(l[0] * l[0] + l[1] * l[1]), MIN_FLAT);
        x[k] = ret[k / NEURAL_RAYS]->ends.x[k % NEURAL_RAYS];
        y[k] = ret[k / NEURAL_RAYS]->ends.y[k % NEURAL_RAYS];
        dx[k] = l[0] / flat;
        dy[k] = -l[1] / flat;
        r[k] = l[2] / flat;
        for (int i = 0; i < 3; i++)
            light[i][k] = l[i];
    }
    const lanes one = lanes_all(1), zero = lanes_all(0);
    const lanes above = r - find_horizons(numbers, x, y, dx, dy, r);
    const lanes clear = lanes_min(lanes_max(above, -one), one);
    const lanes lit = lanes_min(lanes_max(0.5F + 10 * clear, zero), one);
    const lanes shade = lanes_max(find_cosines(numbers, x, y, light), zero) * lit;
    for (int s = 0; s < 2; s++)
        for (int i = 0; i < NEURAL_LIGHT_INPUTS; i++) {
            const lanes of = i == 0 ? shade : i == 1 ? lit : clear;
            const int k = s * NEURAL_RAYS;
            ret[s]->light[i] = ((of[k] + of[k + 1]) + (of[k + 2] + of[k + 3])) / NEURAL_RAYS;
        }
}

/* (g.x, g.y) and f of step 3. */
static void find_directions(const float view[3], const float light[3], float ret_half[2],
                            float ret_difference[2]) {
    float half[3] = {view[0] + light[0], view[1] + light[1], view[2] + light[2]};
    const float length = sqrtf(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
    for (int i = 0; i < 3; i++)
        half[i] /= MAX(length, 1e-6F);
    const float along = light[0] * half[0] + light[1] * half[1];
    const float scale = along / (1 + half[2]) + light[2];
    for (int i = 0; i < 2; i++) {
        ret_half[i] = half[i];
        ret_difference[i] = light[i] - half[i] * scale;
    }
}

LANES_INLINE void make_queries(const struct neural_numbers *numbers,
                               const struct neural_sample *samples, int n,
                               struct neural_query *ret) {
    int own[NEURAL_BATCH], n_own = 0; /* samples with rays of their own */
    for (int s = 0; s < n; s++) {
        ret[s].shared = s > 0 && memcmp(&samples[s], &samples[s - 1],
                                        offsetof(struct neural_sample, light)) == 0;
        if (!ret[s].shared)
            own[n_own++] = s;
    }
    for (int i = 0; i < n_own; i += 2) {
        const int a = own[i], b = own[MIN(i + 1, n_own - 1)];
        find_ends_of_two(numbers, (const struct neural_sample *const[]){&samples[a], &samples[b]},
                         (struct neural_ends *const[]){&ret[a].ends, &ret[b].ends});
    }
    for (int s = 0; s < n; s++)
        if (ret[s].shared)
            ret[s].ends = ret[s - 1].ends;
    for (int s = 0; s < n; s += 2) {
        const int b = MIN(s + 1, n - 1);
        find_light_of_two(numbers, (const struct neural_sample *const[]){&samples[s], &samples[b]},
                          (struct neural_query *const[]){&ret[s], &ret[b]});
    }
    for (int s = 0; s < n; s++)
        find_directions(samples[s].view, samples[s].light, ret[s].half, ret[s].difference);
}

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) static void
make_queries_avx2(const struct neural_numbers *numbers, const struct neural_sample *samples, int n,
                  struct neural_query *ret) {
    make_queries(numbers, samples, n, ret);
}
#endif

void neural_make_queries(const struct neural_numbers *numbers, const struct neural_sample *samples,
                         int n, struct neural_query *ret) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        make_queries_avx2(numbers, samples, n, ret);
        return;
    }
#endif
    make_queries(numbers, samples, n, ret);
}
