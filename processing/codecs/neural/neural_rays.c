/* Finds where rays end on the height map, and the light at these ends: steps 1 to 3 of neural.h.
 * The rays of several samples are in the lanes of vectors. As in neural_layers.c, the functions are
 * compiled for processors with AVX2 and for others. */
#include "neural_private.h"

#include "codecs/lobes/lobes_lanes.h"

#include <math.h>
#include <string.h>

#define SUBRAY         0.25F  /* distance of a ray from the texel's centre in x and y, in texels */
#define MIN_UP         0.05F  /* minimum of v.z, and minimum of r in reach */
#define MIN_FLAT       1e-4F  /* minimum of |(l.x, l.y)| */
#define SLOPE_END      0.375F /* half the length over which a slope is taken, in texels */
#define FIRST          0.375F /* first distance of the scan of the horizon, in texels */
#define STEP           0.25F  /* minimum step of the scan, in texels: half a cell */
#define SIDE_BY_SIDE   4      /* number of vectors of rays whose intervals are halved together */
#define KEYS           64     /* number of keys by which samples are sorted (make_queries()) */
#define KEYS_PER_TEXEL 2      /* keys for each texel that a path crosses in the plane */

G_STATIC_ASSERT(LANES % NEURAL_RAYS == 0);

/* Returns the first of the two cells around each coordinate. *ret_share is the share of the second
 * one. If `repeats` is TRUE, the cells repeat, and cell n is a copy of cell 0 (neural_private.h).
 * If `repeats` is FALSE, coordinates are clamped to the edge. */
LANES_INLINE lane_bits find_cells(lanes at, int n, gboolean repeats, lanes *ret_share) {
    if (repeats) {
        const lanes tiles =
            __builtin_convertvector(__builtin_convertvector(at * (1 / (float)n), lane_bits), lanes);
        const lanes inside = at - tiles * (float)n; /* −n … n */
        const lanes moved = lanes_if(inside < 0, inside + (float)n, inside);
        const lane_bits first = __builtin_convertvector(moved, lane_bits);
        const lane_bits cell = first + (first > n - 1); /* rounding may have given n */
        *ret_share = moved - __builtin_convertvector(cell, lanes);
        return cell;
    }
    const lanes inside = lanes_min(lanes_max(at, lanes_all(0)), lanes_all((float)(n - 1)));
    const lane_bits first = __builtin_convertvector(inside, lane_bits);
    const lane_bits cell = first + (first > n - 2); /* a comparison gives −1 */
    *ret_share = inside - __builtin_convertvector(cell, lanes);
    return cell;
}

typedef float quad __attribute__((vector_size(16)));
typedef double double_pair __attribute__((vector_size(16)));

/* Returns z[0], z[1] and the two cells below them, z[columns] and z[columns + 1]. Uses two loads of
 * two numbers each. */
LANES_INLINE quad load_cells(const float *z, gsize columns) {
    double_pair pairs;
    memcpy(&pairs, z, sizeof pairs / 2);
    memcpy((char *)&pairs + sizeof pairs / 2, z + columns, sizeof pairs / 2);
    return (quad)pairs;
}

/* Gives the cells around the places of all lanes: left, right, left below, right below. */
LANES_INLINE void gather(const float *z, gsize columns, lane_bits at, lanes ret[4]) {
    lanes pairs[4]; /* the cells of lane k, then those of lane k + 4 */
    for (int k = 0; k < 4; k++)
        pairs[k] = __builtin_shufflevector(load_cells(z + (guint32)at[k], columns),
                                           load_cells(z + (guint32)at[k + 4], columns), 0, 1, 2, 3,
                                           4, 5, 6, 7);
    for (int row = 0; row < 2; row++) {
        lanes halves[2]; /* left and right of lanes 0, 1, 4, 5, and of lanes 2, 3, 6, 7 */
        for (int k = 0; k < 2; k++)
            halves[k] = row == 0 ? __builtin_shufflevector(pairs[2 * k], pairs[2 * k + 1], 0, 8, 1,
                                                           9, 4, 12, 5, 13)
                                 : __builtin_shufflevector(pairs[2 * k], pairs[2 * k + 1], 2, 10, 3,
                                                           11, 6, 14, 7, 15);
        ret[2 * row] = __builtin_shufflevector(halves[0], halves[1], 0, 1, 8, 9, 4, 5, 12, 13);
        ret[2 * row + 1] =
            __builtin_shufflevector(halves[0], halves[1], 2, 3, 10, 11, 6, 7, 14, 15);
    }
}

/* Returns the heights H(x, y) at places in texels. The map has at least 2 × 2 cells. */
LANES_INLINE lanes heights_at(const struct neural_numbers *numbers, gboolean repeats, lanes x,
                              lanes y) {
    const int columns = 2 * numbers->width, rows = 2 * numbers->height, stride = columns + 1;
    lanes a, b, z[4];
    const lane_bits i = find_cells(2 * x - 0.5F, columns, repeats, &a);
    const lane_bits at = find_cells(2 * y - 0.5F, rows, repeats, &b) * stride + i;
    gather(numbers->heights, (gsize)stride, at, z);
    const lanes above = z[0] + a * (z[1] - z[0]);
    const lanes below = z[2] + a * (z[3] - z[2]);
    return above + b * (below - above);
}

typedef gint64 wide_bits __attribute__((vector_size(4 * LANES)));
typedef gint64 wide_pair __attribute__((vector_size(2 * LANES)));

LANES_INLINE gboolean any(lane_bits bits) {
    const wide_bits wide = (wide_bits)bits;
    const wide_pair pair =
        __builtin_shufflevector(wide, wide, 0, 1) | __builtin_shufflevector(wide, wide, 2, 3);
    return (pair[0] | pair[1]) != 0;
}

/* Rays in the lanes of vectors. */
struct rays {
    lanes x, y;         /* where the rays meet the reference plane */
    lanes wx, wy;       /* w */
    lanes n;            /* number of steps */
    lanes above, below; /* the interval of heights in which a ray ends */
};

/* Finds, for each ray, the first interval at whose lower end the ray is below the surface. */
LANES_INLINE void march(const struct neural_numbers *numbers, gboolean points, struct rays *rays) {
    const float range = numbers->top - numbers->bottom;
    lanes above = lanes_all(numbers->top), below = above;
    lane_bits going = rays->n >= 0;
    for (lanes k = lanes_all(0); any(going &= k <= rays->n); k += 1) {
        const lanes z = numbers->top - range * k / rays->n;
        above = lanes_if(going, below, above);
        below = lanes_if(going, z, below);
        going &= heights_at(numbers, points, rays->x + rays->wx * z, rays->y + rays->wy * z) < z;
    }
    rays->above = above;
    rays->below = below;
}

/* Halves the intervals of n vectors of rays. Each step of a vector needs the step before
 * it. With several vectors the processor computes the steps of one while it waits for another. */
LANES_INLINE void halve(const struct neural_numbers *numbers, gboolean points, int n,
                        struct rays *rays) {
    for (int k = 0; k < NEURAL_HALVINGS; k++)
        for (int i = 0; i < n; i++) {
            struct rays *one = &rays[i];
            const lanes z = 0.5F * (one->above + one->below);
            const lane_bits under =
                heights_at(numbers, points, one->x + one->wx * z, one->y + one->wy * z) >= z;
            one->below = lanes_if(under, z, one->below);
            one->above = lanes_if(under, one->above, z);
        }
}

/* Returns h of step 2, the slopes of the horizon at (x, y) towards (dx, dy), at least r − 1. All
 * lanes have the same t. A lane whose scan has ended keeps its h. */
LANES_INLINE lanes find_horizons(const struct neural_numbers *numbers, gboolean points, lanes x,
                                 lanes y, lanes dx, lanes dy, lanes r) {
    const lanes z = heights_at(numbers, points, x, y), room = numbers->top - z;
    const lanes reach = (numbers->top - numbers->bottom) / lanes_max(r, lanes_all(MIN_UP)) + 0.5F;
    lanes h = r - 1;
    lane_bits going = reach > 0;
    float t = FIRST;
    for (int k = 0; k < NEURAL_MAX_STEPS; k++) {
        going &= (t <= reach) & (room > h * t);
        if (!any(going))
            break;
        const lanes there = heights_at(numbers, points, x + dx * t, y + dy * t);
        h = lanes_if(going, lanes_max(h, (there - z) / t), h);
        t += MAX(STEP, t / 16);
    }
    return h;
}

/* Returns N · l, where N is the normal of the map at (x, y). */
LANES_INLINE lanes find_cosines(const struct neural_numbers *numbers, gboolean points, lanes x,
                                lanes y, const lanes light[3]) {
    const float e = SLOPE_END;
    const lanes right_down = heights_at(numbers, points, x + e, y + e);
    const lanes right_up = heights_at(numbers, points, x + e, y - e);
    const lanes left_down = heights_at(numbers, points, x - e, y + e);
    const lanes left_up = heights_at(numbers, points, x - e, y - e);
    const lanes s = (right_down + right_up - left_down - left_up) / (4 * e);
    const lanes t = (right_down + left_down - right_up - left_up) / (4 * e);
    return (light[2] - s * light[0] + t * light[1]) / lanes_sqrt(s * s + t * t + 1);
}

LANES_INLINE lanes load(const float from[LANES]) {
    lanes ret;
    memcpy(&ret, from, sizeof ret);
    return ret;
}

/* Sets the rays of LANES / rays samples, except the members that march() sets. */
LANES_INLINE void set_rays(const struct neural_numbers *numbers, gboolean points,
                           const struct neural_sample *samples, const int *which,
                           struct rays *ret) {
    const int rays = points ? 1 : NEURAL_RAYS;
    float x[LANES], y[LANES], wx[LANES], wy[LANES], n[LANES];
    for (int s = 0; s < LANES / rays; s++) {
        const struct neural_sample *sample = &samples[which[s]];
        const float up = MAX(sample->view[2], MIN_UP);
        const float right = sample->view[0] / up, down = -sample->view[1] / up;
        const float slope = MAX(1, sqrtf(right * right + down * down));
        const float steps =
            CLAMP(ceilf(4 * (numbers->top - numbers->bottom) * slope), 1, NEURAL_MAX_STEPS);
        for (int ray = 0; ray < rays; ray++) {
            const int k = s * rays + ray;
            const float apart = points ? 0 : SUBRAY;
            x[k] = sample->x + (ray & 1 ? apart : -apart);
            y[k] = sample->y + (ray & 2 ? apart : -apart);
            wx[k] = right;
            wy[k] = down;
            n[k] = steps;
        }
    }
    ret->x = load(x);
    ret->y = load(y);
    ret->wx = load(wx);
    ret->wy = load(wy);
    ret->n = load(n);
}

/* Finds the ends of the rays in n vectors, at most SIDE_BY_SIDE. A point has one ray, and a texel
 * has NEURAL_RAYS. */
LANES_INLINE void find_ends_of(const struct neural_numbers *numbers, gboolean points, int n,
                               const struct neural_sample *samples, const int *which,
                               struct neural_query *ret) {
    const int rays = points ? 1 : NEURAL_RAYS;
    struct rays all[SIDE_BY_SIDE];
    for (int i = 0; i < n; i++) {
        set_rays(numbers, points, samples, which + i * LANES / rays, &all[i]);
        march(numbers, points, &all[i]);
    }
    halve(numbers, points, n, all);
    for (int i = 0; i < n; i++) {
        const lanes x = all[i].x + all[i].wx * all[i].below;
        const lanes y = all[i].y + all[i].wy * all[i].below;
        for (int k = 0; k < LANES; k++) {
            struct neural_ends *ends = &ret[which[(i * LANES + k) / rays]].ends;
            ends->x[k % rays] = x[k];
            ends->y[k % rays] = y[k];
        }
    }
}

/* Finds shade, lit and clear of LANES / rays samples. The ends of the rays are in the queries of
 * these samples. */
LANES_INLINE void find_light_of(const struct neural_numbers *numbers, gboolean points,
                                const struct neural_sample *samples, const int *which,
                                struct neural_query *ret) {
    const int rays = points ? 1 : NEURAL_RAYS;
    float x[LANES], y[LANES], dx[LANES], dy[LANES], slopes[LANES], l[3][LANES];
    for (int s = 0; s < LANES / rays; s++) {
        const float *light = samples[which[s]].light;
        const struct neural_ends *ends = &ret[which[s]].ends;
        const float flat = MAX(sqrtf(light[0] * light[0] + light[1] * light[1]), MIN_FLAT);
        const float right = light[0] / flat, down = -light[1] / flat, up = light[2] / flat;
        for (int ray = 0; ray < rays; ray++) {
            const int k = s * rays + ray;
            x[k] = ends->x[ray];
            y[k] = ends->y[ray];
            dx[k] = right;
            dy[k] = down;
            slopes[k] = up;
            for (int i = 0; i < 3; i++)
                l[i][k] = light[i];
        }
    }
    const lanes one = lanes_all(1), zero = lanes_all(0), px = load(x), py = load(y);
    const lanes r = load(slopes);
    const lanes above = r - find_horizons(numbers, points, px, py, load(dx), load(dy), r);
    const lanes clear = lanes_min(lanes_max(above, -one), one);
    const lanes lit = lanes_min(lanes_max(0.5F + 10 * clear, zero), one);
    const lanes shade = lanes_max(find_cosines(numbers, points, px, py,
                                               (lanes[]){load(l[0]), load(l[1]), load(l[2])}),
                                  zero) *
                        lit;
    for (int s = 0; s < LANES / rays; s++)
        for (int i = 0; i < NEURAL_LIGHT_INPUTS; i++) {
            const lanes of = i == 0 ? shade : i == 1 ? lit : clear;
            const int k = s * rays;
            ret[which[s]].light[i] =
                points ? of[k] : ((of[k] + of[k + 1]) + (of[k + 2] + of[k + 3])) / NEURAL_RAYS;
        }
}

/* Gives (g.x, g.y) and f of step 3. */
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

/* Sorts the n samples `which` by their keys, which are below KEYS. After the n samples, ret repeats
 * the last one LANES times, to fill the last vector. */
LANES_INLINE void sort(const guint8 *keys, const int *which, int n, int *ret) {
    int ends[KEYS + 1] = {0};
    for (int i = 0; i < n; i++)
        ends[keys[which[i]] + 1]++;
    for (int k = 0; k < KEYS; k++)
        ends[k + 1] += ends[k];
    for (int i = 0; i < n; i++)
        ret[ends[keys[which[i]]]++] = which[i];
    for (int i = 0; i < LANES; i++)
        ret[n + i] = ret[n - 1];
}

/* Does the work of neural_make_queries(). points is a compile-time constant. Samples are sorted so
 * that the loops of all samples in a vector have about the same length. */
LANES_INLINE void make_queries(const struct neural_numbers *numbers, gboolean points,
                               const struct neural_sample *samples, int n,
                               struct neural_query *ret) {
    const int per = LANES / (points ? 1 : NEURAL_RAYS);
    const float deep = (numbers->top - numbers->bottom) * KEYS_PER_TEXEL;
    /* own: the samples that do not share the rays of the sample before
     * all: all samples */
    int own[NEURAL_BATCH], all[NEURAL_BATCH], n_own = 0;
    int sorted[NEURAL_BATCH + LANES];
    guint8 slants[NEURAL_BATCH], reaches[NEURAL_BATCH];
    for (int s = 0; s < n; s++) {
        const float *v = samples[s].view, *l = samples[s].light;
        slants[s] = (guint8)MIN(deep / MAX(v[2], MIN_UP), KEYS - 1);
        reaches[s] =
            (guint8)MIN(deep * sqrtf(MAX(1 - l[2] * l[2], 0)) / MAX(l[2], MIN_UP), KEYS - 1);
        ret[s].shared = s > 0 && memcmp(&samples[s], &samples[s - 1],
                                        offsetof(struct neural_sample, light)) == 0;
        if (!ret[s].shared)
            own[n_own++] = s;
        all[s] = s;
    }
    sort(slants, own, n_own, sorted);
    for (int i = 0; i < n_own; i += SIDE_BY_SIDE * per)
        find_ends_of(numbers, points, MIN(SIDE_BY_SIDE, (n_own - i + per - 1) / per), samples,
                     sorted + i, ret);
    for (int s = 0; s < n; s++)
        if (ret[s].shared)
            ret[s].ends = ret[s - 1].ends;
    sort(reaches, all, n, sorted);
    for (int s = 0; s < n; s += per)
        find_light_of(numbers, points, samples, sorted + s, ret);
    for (int s = 0; s < n; s++)
        find_directions(samples[s].view, samples[s].light, ret[s].half, ret[s].difference);
}

LANES_INLINE void make(const struct neural_numbers *numbers, gboolean points,
                       const struct neural_sample *samples, int n, struct neural_query *ret) {
    if (points)
        make_queries(numbers, TRUE, samples, n, ret);
    else
        make_queries(numbers, FALSE, samples, n, ret);
}

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) static void make_avx2(const struct neural_numbers *numbers,
                                                          gboolean points,
                                                          const struct neural_sample *samples,
                                                          int n, struct neural_query *ret) {
    make(numbers, points, samples, n, ret);
}
#endif

void neural_make_queries(const struct neural_numbers *numbers, gboolean points,
                         const struct neural_sample *samples, int n, struct neural_query *ret) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        make_avx2(numbers, points, samples, n, ret);
        return;
    }
#endif
    make(numbers, points, samples, n, ret);
}
