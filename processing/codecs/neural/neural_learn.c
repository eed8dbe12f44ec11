/* Computes the gradients of the loss, that is, the derivatives of the steps in
 * neural_evaluate.c. */
#include "neural_private.h"

#include <string.h>

void neural_transpose(const struct neural_numbers *numbers, float ret[NEURAL_MAX_WEIGHTS]) {
    const float *from = numbers->weights;
    for (int layer = 0; layer < NEURAL_LAYERS; layer++) {
        const int n = layer == 0 ? neural_inputs(numbers->n_channels) : NEURAL_HIDDEN;
        const int m = layer == NEURAL_LAYERS - 1 ? NEURAL_OUTPUTS : NEURAL_HIDDEN;
        for (int r = 0; r < m; r++)
            for (int i = 0; i < n; i++)
                ret[i * m + r] = from[r * n + i];
        from += m * n;
        ret += m * n;
    }
}

/* Adds the gradient of the loss by the elements of a plane that a sample has read. Row first + k of
 * lesson->inputs is the gradient by the channel k that was read. */
static void add_plane(const struct neural_lesson *lesson, int sample, int first, const float at[2],
                      float *gradient) {
    struct neural_taps taps;
    neural_taps(0.5F * (at[0] + 1), 0.5F * (at[1] + 1), NEURAL_PLANE, NEURAL_PLANE, &taps);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < NEURAL_PLANE_CHANNELS; k++)
            gradient[taps.at[i] * NEURAL_PLANE_CHANNELS + k] +=
                taps.weight[i] * lesson->inputs[first + k][sample];
}

void neural_learn(const struct neural_numbers *numbers, const float *transposed, float share,
                  struct neural_lesson *lesson) {
    const int channels = numbers->n_channels;
    struct neural_gradient *to = &lesson->gradient;
    struct neural_batch batch;
    neural_set_inputs(numbers, FALSE, lesson->queries, NEURAL_BATCH, &batch);
    neural_run_back(numbers, transposed, share, &batch, lesson);
    memset(to->halves, 0, sizeof to->halves);
    memset(to->differences, 0, sizeof to->differences);
    for (int s = 0; s < NEURAL_BATCH; s++) {
        const struct neural_query *query = &lesson->queries[s];
        add_plane(lesson, s, channels, query->half, to->halves);
        add_plane(lesson, s, channels + NEURAL_PLANE_CHANNELS, query->difference, to->differences);
    }
}

void neural_add_surface(const struct neural_numbers *numbers, const struct neural_lesson *lesson,
                        float *gradient) {
    const int channels = numbers->n_channels;
    for (int s = 0; s < NEURAL_BATCH; s++) {
        const struct neural_ends *ends = &lesson->queries[s].ends;
        float column[NEURAL_MAX_CHANNELS];
        for (int k = 0; k < channels; k++)
            column[k] = lesson->inputs[k][s];
        for (int ray = 0; ray < NEURAL_RAYS; ray++) {
            struct neural_taps taps;
            neural_taps(ends->x[ray] / (float)numbers->width, ends->y[ray] / (float)numbers->height,
                        numbers->width, numbers->height, &taps);
            for (int i = 0; i < 4; i++) {
                float *to = gradient + (gsize)taps.at[i] * (gsize)channels;
                for (int k = 0; k < channels; k++)
                    to[k] += taps.weight[i] / NEURAL_RAYS * column[k];
            }
        }
    }
}
