/* Evaluation in batches: steps 4 and 5 of neural.h. */
#include "neural_private.h"

#include <math.h>
#include <string.h>

/* Adds weight times the channels of an element to a column of n rows. */
static inline void add_channels(const float *channels, float weight, int n, float *column) {
    for (int k = 0; k < n; k++)
        column[k] += weight * channels[k];
}

static void read_plane(const float *plane, const float at[2], float *column) {
    struct neural_taps taps;
    neural_taps(0.5F * (at[0] + 1), 0.5F * (at[1] + 1), NEURAL_PLANE, NEURAL_PLANE, &taps);
    for (int i = 0; i < 4; i++)
        add_channels(plane + (gsize)taps.at[i] * NEURAL_PLANE_CHANNELS, taps.weight[i],
                     NEURAL_PLANE_CHANNELS, column);
}

/* Adds the means of the channels of the surface at the ends of the rays. */
static void read_surface(const struct neural_numbers *numbers, const struct neural_ends *ends,
                         float *column) {
    const int channels = numbers->n_channels;
    for (int ray = 0; ray < NEURAL_RAYS; ray++) {
        struct neural_taps taps;
        neural_taps(ends->x[ray] / (float)numbers->width, ends->y[ray] / (float)numbers->height,
                    numbers->width, numbers->height, &taps);
        for (int i = 0; i < 4; i++)
            add_channels(numbers->surface + (gsize)taps.at[i] * (gsize)channels,
                         taps.weight[i] / NEURAL_RAYS, channels, column);
    }
}

void neural_set_inputs(const struct neural_numbers *numbers, const struct neural_query *queries,
                       int n, struct neural_batch *batch) {
    const int channels = numbers->n_channels, inputs = neural_inputs(channels);
    float column[NEURAL_MAX_INPUTS];
    for (int s = 0; s < n; s++) {
        const struct neural_query *query = &queries[s];
        const int kept = query->shared ? channels : 0; /* inputs of the sample before */
        memset(column + kept, 0, sizeof *column * (gsize)(inputs - kept));
        if (!query->shared)
            read_surface(numbers, &query->ends, column);
        read_plane(numbers->halves, query->half, column + channels);
        read_plane(numbers->differences, query->difference,
                   column + channels + NEURAL_PLANE_CHANNELS);
        memcpy(column + channels + 2 * NEURAL_PLANE_CHANNELS, query->light, sizeof query->light);
        for (int k = 0; k < inputs; k++)
            batch->inputs[k][s] = column[k];
    }
}

void neural_evaluate(const struct neural *neural, const struct neural_sample *samples, gsize n,
                     float *ret) {
    const struct neural_numbers *numbers = neural->numbers;
    struct neural_query queries[NEURAL_BATCH];
    struct neural_batch batch;
    for (gsize first = 0; first < n; first += NEURAL_BATCH) {
        const int count = (int)MIN(NEURAL_BATCH, n - first);
        neural_make_queries(numbers, samples + first, count, queries);
        neural_set_inputs(numbers, queries, count, &batch);
        neural_run(numbers, count, &batch);
        for (int s = 0; s < count; s++)
            for (int c = 0; c < 3; c++)
                ret[3 * (first + (gsize)s) + (gsize)c] = batch.colours[c][s];
    }
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
