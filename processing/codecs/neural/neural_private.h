/* The files neural*.c share the numbers of a model as floats, its rays, and its network. */
#pragma once

#include "neural.h"

/* number of samples that the network computes together */
#define NEURAL_BATCH 64

/* The bytes of a model as floats. Heights are in texels. During the training, these are the numbers
 * that are fitted. */
struct neural_numbers {
    int width, height, n_channels;
    float top, bottom; /* heights of the bytes 255 and 0 */
    float *surface;    /* height × width × n_channels */
    /* (2 height + 1) × (2 width + 1): the last row and column are copies of the first */
    float *heights;
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
/* u and v are texture coordinates of a plane of columns × rows. The read is clamped to the edge. */
static inline void neural_taps(float u, float v, int columns, int rows, struct neural_taps *ret) {
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

/* The ends of the rays of neural.h, step 1, in texels. A point has only one ray, element 0. */
struct neural_ends {
    float x[NEURAL_RAYS], y[NEURAL_RAYS];
};

/* The properties of a sample that do not depend on fitted numbers. */
struct neural_query {
    struct neural_ends ends;
    gboolean shared;                  /* whether the sample before has the same ends */
    float half[2], difference[2];     /* (g.x, g.y) and f of step 3 */
    float light[NEURAL_LIGHT_INPUTS]; /* shade, lit and clear of step 2: means over the rays */
};
/* Makes the queries of n ≤ NEURAL_BATCH samples, n > 0. If points is TRUE, a colour has one ray,
 * and the material repeats. Otherwise, a colour has NEURAL_RAYS rays, and places are clamped to the
 * edge. If a sample has the place and the view of the sample before, its ends are those of the
 * sample before. */
void neural_make_queries(const struct neural_numbers *numbers, gboolean points,
                         const struct neural_sample *samples, int n, struct neural_query *ret);

/* The values of a batch in each layer of the network. A row has one value for each of NEURAL_BATCH
 * samples. */
struct neural_batch {
    float inputs[NEURAL_MAX_INPUTS][NEURAL_BATCH];
    float hidden[2][NEURAL_HIDDEN][NEURAL_BATCH]; /* after max(y, 0.01 y) */
    float outputs[NEURAL_OUTPUTS][NEURAL_BATCH];
    float colours[3][NEURAL_BATCH];
} __attribute__((aligned(64)));

/* Sets the inputs of the first n samples. points is as for neural_make_queries(). */
void neural_set_inputs(const struct neural_numbers *numbers, gboolean points,
                       const struct neural_query *queries, int n, struct neural_batch *batch);
/* Computes the colours of the first n samples from their inputs (steps 4 and 5 of neural.h). */
void neural_run(const struct neural_numbers *numbers, int n, struct neural_batch *batch);

/* Makes the height map of a model from points: sets heights and height_scale. Without points, the
 * map is flat and lies in the reference plane. */
void neural_set_heights(struct neural *neural, const struct codec_geometry *geometry);

/* Gradients of the loss by all numbers except the heights and the channels of the surface. Each
 * member is the gradient by the member of struct neural_numbers with the same name. */
struct neural_gradient {
    float halves[NEURAL_PLANE_VALUES], differences[NEURAL_PLANE_VALUES];
    float weights[NEURAL_MAX_WEIGHTS], biases[NEURAL_ROWS];
} __attribute__((aligned(64)));

/* The samples of a batch, and what the training computes from them. */
struct neural_lesson {
    struct neural_query queries[NEURAL_BATCH];
    float targets[3][NEURAL_BATCH]; /* R, G, B of the BTF; NaN: the sample is left out */
    /* gradient of the loss by the inputs: rows of NEURAL_BATCH samples */
    float inputs[NEURAL_MAX_INPUTS][NEURAL_BATCH];
    struct neural_gradient gradient;
    double loss; /* Σ over samples and colours of the squared difference after the curve */
} __attribute__((aligned(64)));

/* Gives the weights with rows and columns exchanged in each layer, as neural_learn() needs them. */
void neural_transpose(const struct neural_numbers *numbers, float ret[NEURAL_MAX_WEIGHTS]);

/* Computes the loss and the gradients of the lesson's samples. share is the weight of each sample
 * in the loss. The gradient of the surface is not computed here; the caller takes it from
 * lesson->inputs with neural_add_surface(). */
void neural_learn(const struct neural_numbers *numbers, const float *transposed, float share,
                  struct neural_lesson *lesson);
/* Adds a lesson's gradient by the channels of the surface to `gradient`, height × width ×
 * n_channels. */
void neural_add_surface(const struct neural_numbers *numbers, const struct neural_lesson *lesson,
                        float *gradient);

/* Runs a lesson through the layers, forwards and backwards (neural_layers.c). From batch and
 * lesson->targets, computes lesson->inputs, the gradients by weights and biases, and the loss. */
void neural_run_back(const struct neural_numbers *numbers, const float *transposed, float share,
                     struct neural_batch *batch, struct neural_lesson *lesson);

/* Threads that run short loops, many times a second. The calling thread works as well. The caller
 * may run one loop at a time. */
struct neural_crew;
struct neural_crew *neural_crew_new(int n_threads); /* 0: one per processor */
void neural_crew_free(struct neural_crew *crew);
/* Calls func for each block from 0 to n − 1, in any thread and order. */
void neural_crew_run(struct neural_crew *crew, int n, WorkBlock func, gpointer data);

/* Numbers that are fitted with one learning rate: their values, gradients and moments. */
struct neural_group {
    const char *name;
    float *values, *gradient;
    float *mean, *square; /* moments of the gradients in Adam: mean, and mean of the squares */
    gsize n;
    float rate;
};
#define NEURAL_GROUPS 5

/* A training of neural->numbers (neural_train.c). */
struct neural_trainer {
    const struct btf_matrix *btf;
    const struct neural_options *options;
    struct neural *neural; /* gives directions and texels */
    struct neural_numbers *numbers;
    float transposed[NEURAL_MAX_WEIGHTS];
    float *surface_gradient;
    struct neural_gradient gradient;
    /* channels of the surface, halves, differences, weights, biases */
    struct neural_group groups[NEURAL_GROUPS];
    struct neural_lesson *lessons; /* lessons of a step */
    struct neural_crew *crew;
    /* step: number of steps that are done
     * steps: number of all steps */
    int step, steps;
};

/* Begins a training with random numbers. The arguments must outlive the trainer. */
struct neural_trainer *neural_trainer_new(struct neural *neural, const struct btf_matrix *btf,
                                          const struct neural_options *options);
void neural_trainer_free(struct neural_trainer *trainer);
/* Draws the samples of a step, and adds the gradients of their mean loss to the gradients of the
 * groups. */
void neural_trainer_learn(struct neural_trainer *trainer);
/* Changes the numbers by a step of Adam. Gradients become 0. */
void neural_trainer_step(struct neural_trainer *trainer);
