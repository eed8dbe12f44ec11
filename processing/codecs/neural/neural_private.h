/* The files neural*.c share the numbers of a model as floats, its rays, and its network. */
#pragma once

#include "neural.h"

/* Samples that the network computes together. */
#define NEURAL_BATCH 64

/* The bytes of a model as floats. Heights are in texels. During the training, these are the numbers
 * that are fitted. */
struct neural_numbers {
    int width, height, n_channels;
    float top, bottom; /* heights of the bytes 255 and 0 */
    float *surface;    /* height × width × n_channels */
    float *heights;    /* 2 height × 2 width */
    float halves[NEURAL_PLANE_VALUES], differences[NEURAL_PLANE_VALUES];
    float weights[NEURAL_MAX_WEIGHTS], biases[NEURAL_ROWS];
};

struct neural_numbers *neural_numbers_new(int width, int height, int n_channels);
void neural_numbers_free(struct neural_numbers *numbers); /* NULL is ignored */

/* A bilinear read: four elements of a plane, row by row, and their weights. */
struct neural_taps {
    int at[4];
    float weight[4];
};
/* u and v are texture coordinates 0 … 1 of a plane of columns × rows. */
void neural_taps(float u, float v, int columns, int rows, struct neural_taps *ret);

/* The ends of the rays of neural.h, step 1, in texels. */
struct neural_ends {
    float x[NEURAL_RAYS], y[NEURAL_RAYS];
};
void neural_find_ends(const struct neural_numbers *numbers, float x, float y, const float view[3],
                      struct neural_ends *ret);
/* shade, lit and clear of step 2: means over the rays. */
void neural_find_light(const struct neural_numbers *numbers, const struct neural_ends *ends,
                       const float light[3], float ret[NEURAL_LIGHT_INPUTS]);
/* (g.x, g.y) and f of step 3. */
void neural_find_directions(const float view[3], const float light[3], float ret_half[2],
                            float ret_difference[2]);

/* A sample as far as it does not depend on fitted numbers. */
struct neural_query {
    struct neural_ends ends;
    float half[2], difference[2];
    float light[NEURAL_LIGHT_INPUTS];
};
void neural_make_query(const struct neural_numbers *numbers, const struct neural_sample *sample,
                       struct neural_query *ret);

/* All values of a batch on their way through the network: rows of NEURAL_BATCH samples. */
struct neural_batch {
    float inputs[NEURAL_MAX_INPUTS][NEURAL_BATCH];
    float hidden[2][NEURAL_HIDDEN][NEURAL_BATCH]; /* after max(y, 0.01 y) */
    float outputs[NEURAL_OUTPUTS][NEURAL_BATCH];
    float colours[3][NEURAL_BATCH];
} __attribute__((aligned(64)));

/* Sets the inputs of n ≤ NEURAL_BATCH samples, and 0 for the others. */
void neural_set_inputs(const struct neural_numbers *numbers, const struct neural_query *queries,
                       int n, struct neural_batch *batch);
/* Steps 4 and 5: from inputs to colours. */
void neural_run(const struct neural_numbers *numbers, struct neural_batch *batch);
