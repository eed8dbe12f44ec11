/* Evaluation in batches: steps 4 and 5 of neural.h. */
#include "neural_private.h"

#include "codecs/lobes/lobes_lanes.h"

#include <math.h>
#include <string.h>

#define GROUP 4 /* number of channels in a vector */

typedef float quad __attribute__((vector_size(4 * GROUP)));
typedef gint32 quad_bits __attribute__((vector_size(4 * GROUP)));

LANES_INLINE quad quad_load(const float *from) {
    quad ret;
    memcpy(&ret, from, sizeof ret);
    return ret;
}

/* Adds weight times the channels of an element to a column of inputs. A group is GROUP channels,
 * and the element has n groups. */
LANES_INLINE void add_channels(const float *channels, float weight, int n, quad *column) {
    for (int k = 0; k < n; k++)
        column[k] += weight * quad_load(channels + k * GROUP);
}

LANES_INLINE void read_plane(const float *plane, const float at[2], quad *column) {
    struct neural_taps taps;
    neural_taps(0.5F * (at[0] + 1), 0.5F * (at[1] + 1), NEURAL_PLANE, NEURAL_PLANE, &taps);
    for (int i = 0; i < 4; i++)
        add_channels(plane + taps.at[i] * NEURAL_PLANE_CHANNELS, taps.weight[i],
                     NEURAL_PLANE_CHANNELS / GROUP, column);
}

LANES_INLINE quad quad_clamp(quad x, float most) {
    const quad low = (quad){0} + 0, high = (quad){0} + most;
    const quad_bits above = x > high, below = x < low;
    x = (quad)((above & (quad_bits)high) | (~above & (quad_bits)x));
    return (quad)(~below & (quad_bits)x);
}

/* Finds the four elements of the surface, and their weights, at the ends of all rays of a texel.
 * The results are those of neural_taps(). */
LANES_INLINE void find_taps(const struct neural_numbers *numbers, const struct neural_ends *ends,
                            quad_bits at[4], quad weights[4]) {
    const float width = (float)numbers->width, height = (float)numbers->height;
    const quad x = quad_clamp(quad_load(ends->x) / width * width - 0.5F, width - 1);
    const quad y = quad_clamp(quad_load(ends->y) / height * height - 0.5F, height - 1);
    const quad_bits i = __builtin_convertvector(x, quad_bits);
    const quad_bits j = __builtin_convertvector(y, quad_bits);
    const quad_bits right = (i + 1 < numbers->width) & 1;
    const quad_bits down = (j + 1 < numbers->height) & numbers->width;
    const quad a = x - __builtin_convertvector(i, quad), b = y - __builtin_convertvector(j, quad);
    at[0] = j * numbers->width + i;
    at[1] = at[0] + right;
    at[2] = at[0] + down;
    at[3] = at[2] + right;
    weights[0] = (1 - a) * (1 - b);
    weights[1] = a * (1 - b);
    weights[2] = (1 - a) * b;
    weights[3] = a * b;
}

/* Gives the element at a coordinate and the next one, in a row of n elements that repeats.
 * *ret_share is the share of the next one. */
LANES_INLINE void repeat(float at, int n, int ret[2], float *ret_share) {
    const float whole = floorf(at);
    const int rest = (int)(whole - (float)n * floorf(whole / (float)n));
    ret[0] = CLAMP(rest, 0, n - 1);
    ret[1] = rest + 1 < n ? rest + 1 : 0;
    *ret_share = at - whole;
}

/* Gives the four elements around a place in texels, and their weights, for a bilinear read of the
 * surface. The surface repeats. */
LANES_INLINE void repeat_taps(float x, float y, int width, int height, struct neural_taps *ret) {
    int i[2], j[2];
    float a, b;
    repeat(x - 0.5F, width, i, &a);
    repeat(y - 0.5F, height, j, &b);
    for (int k = 0; k < 4; k++) {
        ret->at[k] = j[k / 2] * width + i[k % 2];
        ret->weight[k] = (k % 2 ? a : 1 - a) * (k / 2 ? b : 1 - b);
    }
}

/* Reads `groups` groups of channels of the surface: the means of their values at the ends of the
 * rays. groups and points are compile-time constants, so that the sums stay in registers. */
LANES_INLINE void read_groups(const struct neural_numbers *numbers, int groups, gboolean points,
                              const struct neural_ends *ends, quad *column) {
    quad sums[NEURAL_MAX_CHANNELS / GROUP] = {{0}};
    if (points) {
        struct neural_taps taps;
        repeat_taps(ends->x[0], ends->y[0], numbers->width, numbers->height, &taps);
        for (int i = 0; i < 4; i++)
            add_channels(numbers->surface + (gsize)taps.at[i] * (gsize)(groups * GROUP),
                         taps.weight[i], groups, sums);
    } else {
        quad_bits at[4];
        quad weights[4];
        find_taps(numbers, ends, at, weights);
        for (int ray = 0; ray < NEURAL_RAYS; ray++)
            for (int i = 0; i < 4; i++)
                add_channels(numbers->surface + (gsize)at[i][ray] * (gsize)(groups * GROUP),
                             weights[i][ray] / NEURAL_RAYS, groups, sums);
    }
    memcpy(column, sums, sizeof *sums * (gsize)groups);
}

LANES_INLINE void read_surface(const struct neural_numbers *numbers, gboolean points,
                               const struct neural_ends *ends, quad *column) {
    switch (numbers->n_channels / GROUP) {
    case 1:
        read_groups(numbers, 1, points, ends, column);
        return;
    case 2:
        read_groups(numbers, 2, points, ends, column);
        return;
    case 3:
        read_groups(numbers, 3, points, ends, column);
        return;
    default:
        read_groups(numbers, 4, points, ends, column);
    }
}

LANES_INLINE void set_inputs(const struct neural_numbers *numbers, gboolean points,
                             const struct neural_query *queries, int n,
                             struct neural_batch *batch) {
    const int channels = numbers->n_channels, inputs = neural_inputs(channels);
    const int planes = channels / GROUP, apart = NEURAL_PLANE_CHANNELS / GROUP;
    quad column[(NEURAL_MAX_INPUTS + GROUP - 1) / GROUP] = {{0}};
    for (int s = 0; s < n; s++) {
        const struct neural_query *query = &queries[s];
        /* if the ends are shared, the column still has the values of the sample before */
        if (!query->shared)
            read_surface(numbers, points, &query->ends, column);
        memset(column + planes, 0, sizeof *column * 2 * (gsize)apart);
        read_plane(numbers->halves, query->half, column + planes);
        read_plane(numbers->differences, query->difference, column + planes + apart);
        memcpy(column + planes + 2 * apart, query->light, sizeof query->light);
        for (int k = 0; k < inputs; k++)
            batch->inputs[k][s] = column[k / GROUP][k % GROUP];
    }
}

LANES_INLINE void set(const struct neural_numbers *numbers, gboolean points,
                      const struct neural_query *queries, int n, struct neural_batch *batch) {
    if (points)
        set_inputs(numbers, TRUE, queries, n, batch);
    else
        set_inputs(numbers, FALSE, queries, n, batch);
}

#if defined(__x86_64__)
/* FMA is not used, so that the sums are the same on all processors. */
__attribute__((target("avx2"))) static void set_avx2(const struct neural_numbers *numbers,
                                                     gboolean points,
                                                     const struct neural_query *queries, int n,
                                                     struct neural_batch *batch) {
    set(numbers, points, queries, n, batch);
}
#endif

void neural_set_inputs(const struct neural_numbers *numbers, gboolean points,
                       const struct neural_query *queries, int n, struct neural_batch *batch) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        set_avx2(numbers, points, queries, n, batch);
        return;
    }
#endif
    set(numbers, points, queries, n, batch);
}

static void evaluate(const struct neural *neural, gboolean points,
                     const struct neural_sample *samples, gsize n, float *ret) {
    const struct neural_numbers *numbers = neural->numbers;
    struct neural_query queries[NEURAL_BATCH];
    struct neural_batch batch;
    for (gsize first = 0; first < n; first += NEURAL_BATCH) {
        const int count = (int)MIN(NEURAL_BATCH, n - first);
        neural_make_queries(numbers, points, samples + first, count, queries);
        neural_set_inputs(numbers, points, queries, count, &batch);
        neural_run(numbers, count, &batch);
        for (int s = 0; s < count; s++)
            for (int c = 0; c < 3; c++)
                ret[3 * (first + (gsize)s) + (gsize)c] = batch.colours[c][s];
    }
}

void neural_evaluate(const struct neural *neural, const struct neural_sample *samples, gsize n,
                     float *ret) {
    evaluate(neural, FALSE, samples, n, ret);
}

void neural_evaluate_points(const struct neural *neural, const struct neural_sample *samples,
                            gsize n, float *ret) {
    evaluate(neural, TRUE, samples, n, ret);
}

void neural_reconstruct(const struct neural *neural, int texel, float *ret) {
    const struct btf_layout *layout = &neural->layout;
    const gsize n_lights = layout->lights.n, n = layout->views.n * n_lights;
    const int row = texel / (int)layout->width, column = texel % (int)layout->width;
    g_autofree struct neural_sample *samples = g_new(struct neural_sample, n);
    for (gsize i = 0; i < n; i++) {
        samples[i].x = (float)column + 0.5F;
        samples[i].y = (float)row + 0.5F;
        neural_view(neural, (int)(i / n_lights), texel, samples[i].view);
        neural_light(neural, (int)(i % n_lights), texel, samples[i].light);
    }
    neural_evaluate(neural, samples, n, ret);
}
