#include "neural_private.h"

#include "base/data_error.h"
#include "btf/btf_checkpoint.h"
#include "codecs/codec/codec_geometry.h"
#include "codecs/codec/texel_model.h"

#include <math.h>
#include <string.h>

#define COLOURS    3
#define BATCHES    (NEURAL_STEP / NEURAL_BATCH)
#define TRIES      16 /* maximum number of draws of a sample, until its value is not NaN */
#define ADAM_BLOCK 8192

#define DEFAULT_CHANNELS  12
#define DEFAULT_PER_TEXEL 3000.0
#define MOST_PER_TEXEL    1e6

/* Constants of Adam, and of the learning rate. */
#define RATE    0.02F /* rate of channels and planes; the network has half of it */
#define WARM_UP 50
#define FALL    0.02 /* the last rate as a share of the first */
#define BETA_1  0.9F
#define BETA_2  0.99F
#define EPSILON 1e-12F

/* Returns a random number for a counter (SplitMix64). Each sample of each step has its own counter,
 * so that the threads can draw in any order. */
static guint64 mix(guint64 x) {
    x += 0x9e3779b97f4a7c15U;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
    return x ^ (x >> 31);
}

/* Returns a number from 0 to n − 1 from the upper half of 64 random bits. */
static int below(guint64 random, gsize n) {
    return (int)(((random >> 32) * n) >> 32);
}

static double normal(guint64 seed) {
    const double u = (double)((mix(seed) >> 11) + 1) / 9007199254740993.0;
    const double v = (double)(mix(seed ^ 0x5bd1e995U) >> 11) / 9007199254740992.0;
    return sqrt(-2 * log(u)) * cos(2 * G_PI * v);
}

static void fill(float *values, gsize n, double deviation, guint64 seed) {
    for (gsize i = 0; i < n; i++)
        values[i] = (float)(deviation * normal(mix(seed) + i));
}

/* Sets the initial numbers. The standard deviation of a weight is √(2 / inputs), and a tenth of
 * this in the last layer. The biases of the last layer begin at a medium grey. */
static void begin_numbers(struct neural_numbers *numbers, guint32 seed) {
    const gsize n_inputs = (gsize)neural_inputs(numbers->n_channels);
    const guint64 first = (guint64)seed << 8;
    float *weights = numbers->weights;
    fill(numbers->surface,
         (gsize)numbers->width * (gsize)numbers->height * (gsize)numbers->n_channels, 0.1, first);
    fill(numbers->halves, NEURAL_PLANE_VALUES, 0.1, first + 1);
    fill(numbers->differences, NEURAL_PLANE_VALUES, 0.1, first + 2);
    fill(weights, NEURAL_HIDDEN * n_inputs, sqrt(2.0 / (double)n_inputs), first + 3);
    weights += NEURAL_HIDDEN * n_inputs;
    fill(weights, (gsize)NEURAL_HIDDEN * NEURAL_HIDDEN, sqrt(2.0 / NEURAL_HIDDEN), first + 4);
    weights += NEURAL_HIDDEN * NEURAL_HIDDEN;
    fill(weights, (gsize)NEURAL_OUTPUTS * NEURAL_HIDDEN, 0.1 * sqrt(2.0 / NEURAL_HIDDEN),
         first + 5);
    for (int i = 0; i < NEURAL_OUTPUTS; i++)
        numbers->biases[2 * NEURAL_HIDDEN + i] = 0.5F;
}

/* Draws sample number `index` of the training, and gives its measured colour. */
static void draw(const struct neural_trainer *trainer, guint64 index, struct neural_sample *ret,
                 float target[COLOURS]) {
    const struct btf_layout *layout = &trainer->btf->layout;
    const gsize n_views = layout->views.n, n_lights = layout->lights.n;
    guint64 random = mix(((guint64)trainer->options->seed << 40) + index);
    int texel = 0, view = 0, light = 0;
    for (int i = 0; i < TRIES; i++) {
        texel = below(random = mix(random), btf_layout_texels(layout));
        view = below(random = mix(random), n_views);
        light = below(random = mix(random), n_lights);
        const gsize at = ((gsize)texel * n_views + (gsize)view) * n_lights + (gsize)light;
        memcpy(target, trainer->btf->values + at * COLOURS, sizeof *target * COLOURS);
        if (!isnan(target[0]) && !isnan(target[1]) && !isnan(target[2]))
            break;
    }
    const int row = texel / (int)layout->width, column = texel % (int)layout->width;
    ret->x = (float)column + 0.5F;
    ret->y = (float)row + 0.5F;
    neural_view(trainer->neural, view, texel, ret->view);
    neural_light(trainer->neural, light, texel, ret->light);
}

static void learn_batch(int batch, gpointer data) {
    struct neural_trainer *trainer = data;
    struct neural_lesson *lesson = &trainer->lessons[batch];
    const guint64 first =
        ((guint64)trainer->step * BATCHES + (guint64)batch) * (guint64)NEURAL_BATCH;
    struct neural_sample samples[NEURAL_BATCH];
    for (int s = 0; s < NEURAL_BATCH; s++) {
        float target[COLOURS];
        draw(trainer, first + (guint64)s, &samples[s], target);
        for (int c = 0; c < COLOURS; c++)
            lesson->targets[c][s] = target[c];
    }
    neural_make_queries(trainer->numbers, FALSE, samples, NEURAL_BATCH, lesson->queries);
    neural_learn(trainer->numbers, trainer->transposed, 1.0F / (COLOURS * NEURAL_STEP), lesson);
}

/* Adds the gradients of all batches, always in the same order. */
static void sum_gradients(struct neural_trainer *trainer) {
    float *sum = (float *)&trainer->gradient;
    const gsize n = sizeof trainer->gradient / sizeof *sum;
    memset(sum, 0, sizeof trainer->gradient);
    for (int batch = 0; batch < BATCHES; batch++) {
        const struct neural_lesson *lesson = &trainer->lessons[batch];
        const float *part = (const float *)&lesson->gradient;
        for (gsize i = 0; i < n; i++)
            sum[i] += part[i];
        neural_add_surface(trainer->numbers, lesson, trainer->surface_gradient);
    }
}

/* Makes a step of Adam for a block of the numbers of all groups. Gradients become 0. */
static void adam_block(int block, gpointer data) {
    const struct neural_trainer *trainer = data;
    const int k = trainer->step;
    const double share = MIN(1, (k + 1.0) / WARM_UP) * pow(FALL, (double)k / trainer->steps);
    const double unbias_1 = 1 - pow((double)BETA_1, k + 1.0);
    const double unbias_2 = 1 - pow((double)BETA_2, k + 1.0);
    gsize first = (gsize)block * ADAM_BLOCK, left = ADAM_BLOCK;
    for (int g = 0; g < NEURAL_GROUPS && left > 0; g++) {
        const struct neural_group *group = &trainer->groups[g];
        const gsize skip = MIN(first, group->n), n = MIN(left, group->n - skip);
        const float rate = (float)((double)group->rate * share / unbias_1);
        const float scale = (float)(1 / sqrt(unbias_2));
        float *restrict value = group->values + skip, *restrict gradient = group->gradient + skip;
        float *restrict mean = group->mean + skip, *restrict square = group->square + skip;
        for (gsize i = 0; i < n; i++) {
            mean[i] += (1 - BETA_1) * (gradient[i] - mean[i]);
            square[i] += (1 - BETA_2) * (gradient[i] * gradient[i] - square[i]);
            value[i] -= rate * mean[i] / (scale * sqrtf(square[i]) + EPSILON);
            gradient[i] = 0;
        }
        first -= skip;
        left -= n;
    }
}

static void set_groups(struct neural_trainer *trainer) {
    struct neural_numbers *numbers = trainer->numbers;
    struct neural_gradient *gradient = &trainer->gradient;
    const gsize surface =
        (gsize)numbers->width * (gsize)numbers->height * (gsize)numbers->n_channels;
    const struct neural_group groups[NEURAL_GROUPS] = {
        {.name = "surface",
         numbers->surface,
         trainer->surface_gradient,
         .n = surface,
         .rate = RATE},
        {"halves", numbers->halves, gradient->halves, .n = NEURAL_PLANE_VALUES, .rate = RATE},
        {"differences", numbers->differences, gradient->differences, .n = NEURAL_PLANE_VALUES,
         .rate = RATE},
        {"weights", numbers->weights, gradient->weights,
         .n = (gsize)neural_weights(numbers->n_channels), .rate = RATE / 2},
        {"biases", numbers->biases, gradient->biases, .n = NEURAL_ROWS, .rate = RATE / 2},
    };
    memcpy(trainer->groups, groups, sizeof groups);
    for (int g = 0; g < NEURAL_GROUPS; g++) {
        trainer->groups[g].mean = g_new0(float, groups[g].n);
        trainer->groups[g].square = g_new0(float, groups[g].n);
    }
}

/* Copies an array of an earlier run from the checkpoint. */
static gboolean take(Checkpoint *checkpoint, const char *group, const char *what, gpointer to,
                     gsize size) {
    g_autofree char *name = g_strdup_printf("%s %s", group, what);
    gconstpointer from = checkpoint_get(checkpoint, name, size);
    if (from)
        memcpy(to, from, size);
    checkpoint_keep(checkpoint, name, to, size);
    return from != NULL;
}

static void resume(struct neural_trainer *trainer) {
    Checkpoint *checkpoint = trainer->options->checkpoint;
    const struct neural_options *options = trainer->options;
    g_autofree char *what =
        g_strdup_printf("neural of %d, %d steps, seed %u", trainer->numbers->n_channels,
                        trainer->steps, options->seed);
    gboolean all = TRUE;
    btf_checkpoint_begin(checkpoint, trainer->btf, what);
    for (int g = 0; g < NEURAL_GROUPS; g++) {
        const struct neural_group *group = &trainer->groups[g];
        const gsize size = sizeof(float) * group->n;
        all = take(checkpoint, group->name, "values", group->values, size) && all;
        all = take(checkpoint, group->name, "mean", group->mean, size) && all;
        all = take(checkpoint, group->name, "square", group->square, size) && all;
    }
    take(checkpoint, "training", "step", &trainer->step, sizeof trainer->step);
    if (all || trainer->step == 0)
        return;
    /* A checkpoint that lacks an array cannot be used. */
    trainer->step = 0;
    begin_numbers(trainer->numbers, options->seed);
    for (int g = 0; g < NEURAL_GROUPS; g++) {
        memset(trainer->groups[g].mean, 0, sizeof(float) * trainer->groups[g].n);
        memset(trainer->groups[g].square, 0, sizeof(float) * trainer->groups[g].n);
    }
}

void neural_trainer_learn(struct neural_trainer *trainer) {
    neural_transpose(trainer->numbers, trainer->transposed);
    neural_crew_run(trainer->crew, BATCHES, learn_batch, trainer);
    sum_gradients(trainer);
}

void neural_trainer_step(struct neural_trainer *trainer) {
    gsize n = 0;
    for (int g = 0; g < NEURAL_GROUPS; g++)
        n += trainer->groups[g].n;
    neural_crew_run(trainer->crew, (int)((n + ADAM_BLOCK - 1) / ADAM_BLOCK), adam_block, trainer);
    trainer->step++;
}

static gboolean train(struct neural_trainer *trainer, GError **error) {
    const struct work *work = &trainer->options->work;
    Checkpoint *checkpoint = trainer->options->checkpoint;
    const gint64 begun_us = g_get_monotonic_time();
    gint64 told_us = begun_us;
    gboolean ok = work_tell(work, "train", trainer->step, trainer->steps, begun_us, error);
    while (ok && trainer->step < trainer->steps) {
        neural_trainer_learn(trainer);
        neural_trainer_step(trainer);
        if (checkpoint)
            checkpoint_save_if_due(checkpoint);
        const gint64 now_us = g_get_monotonic_time();
        if (now_us - told_us > G_USEC_PER_SEC / 10 || trainer->step == trainer->steps) {
            told_us = now_us;
            ok = work_tell(work, "train", trainer->step, trainer->steps, begun_us, error);
        }
    }
    if (checkpoint && !ok)
        checkpoint_save(checkpoint);
    if (checkpoint)
        checkpoint_drop(checkpoint, NULL);
    return ok;
}

/* Rounds n elements of n_channels channels to bytes, with the range of each channel. */
static void round_channels(const float *values, gsize n, gsize n_channels, guint8 *ret,
                           struct neural_scale *ret_scales) {
    for (gsize k = 0; k < n_channels; k++) {
        float lowest = values[k], highest = values[k];
        for (gsize i = 0; i < n; i++) {
            lowest = MIN(lowest, values[i * n_channels + k]);
            highest = MAX(highest, values[i * n_channels + k]);
        }
        const float step = MAX(highest - lowest, 1e-8F) / 255;
        ret_scales[k] = (struct neural_scale){lowest, step};
        for (gsize i = 0; i < n; i++)
            ret[i * n_channels + k] =
                (guint8)CLAMP(lrintf((values[i * n_channels + k] - lowest) / step), 0, 255);
    }
}

/* Sets the bytes of the model to the fitted numbers. */
static void round_numbers(const struct neural_numbers *numbers, struct neural *neural) {
    const gsize plane = (gsize)NEURAL_PLANE * NEURAL_PLANE;
    const float *weights = numbers->weights;
    guint8 *bytes = neural->weights;
    round_channels(numbers->surface, btf_layout_texels(&neural->layout), (gsize)neural->n_channels,
                   neural->surface, neural->surface_scales);
    round_channels(numbers->halves, plane, NEURAL_PLANE_CHANNELS, neural->halves,
                   neural->half_scales);
    round_channels(numbers->differences, plane, NEURAL_PLANE_CHANNELS, neural->differences,
                   neural->difference_scales);
    for (int row = 0; row < NEURAL_ROWS; row++) {
        const int n = row < NEURAL_HIDDEN ? neural_inputs(neural->n_channels) : NEURAL_HIDDEN;
        round_channels(weights, (gsize)n, 1, bytes, &neural->rows[row]);
        weights += n;
        bytes += n;
    }
    memcpy(neural->biases, numbers->biases, sizeof neural->biases);
}

static void reconstruct(gconstpointer model, int texel, float *ret) {
    neural_reconstruct(model, texel, ret);
}

/* Computes the errors of the fitted numbers and of the rounded numbers. Before the call,
 * neural->numbers are the fitted numbers. Afterwards, they are the rounded numbers. */
static gboolean find_errors(struct neural *neural, const struct btf_matrix *btf,
                            const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    double ignored;
    if (!work_tell(work, "errors", 0, 2, begun_us, error))
        return FALSE;
    texel_model_errors(btf, reconstruct, neural, work->n_threads, &neural->exact_error, &ignored);
    round_numbers(neural->numbers, neural);
    neural_prepare(neural);
    if (!work_tell(work, "errors", 1, 2, begun_us, error))
        return FALSE;
    texel_model_errors(btf, reconstruct, neural, work->n_threads, &neural->error,
                       &neural->luminance_error);
    return work_tell(work, "errors", 2, 2, begun_us, error);
}

struct neural_trainer *neural_trainer_new(struct neural *neural, const struct btf_matrix *btf,
                                          const struct neural_options *options) {
    const double texels = (double)btf_layout_texels(&btf->layout);
    const double per_texel = options->per_texel > 0 ? options->per_texel : DEFAULT_PER_TEXEL;
    struct neural_trainer *trainer = g_aligned_alloc0(1, sizeof *trainer, 64);
    trainer->btf = btf;
    trainer->options = options;
    trainer->neural = neural;
    trainer->numbers = neural->numbers;
    trainer->surface_gradient = g_new0(float, (gsize)texels *(gsize)neural->n_channels);
    trainer->lessons = g_aligned_alloc0(BATCHES, sizeof *trainer->lessons, 64);
    trainer->steps = (int)CLAMP(texels * per_texel / NEURAL_STEP, NEURAL_MIN_STEPS, G_MAXINT / 2);
    trainer->crew = neural_crew_new(options->work.n_threads);
    set_groups(trainer);
    begin_numbers(trainer->numbers, options->seed);
    return trainer;
}

void neural_trainer_free(struct neural_trainer *trainer) {
    neural_crew_free(trainer->crew);
    for (int g = 0; g < NEURAL_GROUPS; g++) {
        g_free(trainer->groups[g].mean);
        g_free(trainer->groups[g].square);
    }
    g_free(trainer->surface_gradient);
    g_aligned_free(trainer->lessons);
    g_aligned_free(trainer);
}

/* Fits neural->numbers. */
static gboolean fit(struct neural *neural, const struct btf_matrix *btf,
                    const struct neural_options *options, GError **error) {
    struct neural_trainer *trainer = neural_trainer_new(neural, btf, options);
    if (options->checkpoint)
        resume(trainer);
    const gboolean ok = train(trainer, error);
    neural_trainer_free(trainer);
    return ok;
}

static gboolean check_options(const struct neural_options *options, GError **error) {
    const int n = options->n_channels;
    if (n < 0 || n > NEURAL_MAX_CHANNELS || n % 4 != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "neural planes cannot have %d channels; give 4, 8, 12 or 16", n);
        return FALSE;
    }
    if (options->per_texel >= 0 && options->per_texel <= MOST_PER_TEXEL)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "%g samples per texel are not possible; give 1 to %g", options->per_texel,
                MOST_PER_TEXEL);
    return FALSE;
}

struct neural *neural_compute(const struct btf_matrix *btf, const struct neural_options *options,
                              GError **error) {
    if (!check_options(options, error) || !texel_model_check(btf, error))
        return NULL;
    const gsize texels = btf_layout_texels(&btf->layout);
    const struct codec_geometry *geometry = options->geometry;
    struct neural *neural = g_new0(struct neural, 1);
    neural->name = g_strdup(btf->name);
    neural->layout = btf_layout_copy(&btf->layout);
    neural->n_channels = options->n_channels ? options->n_channels : DEFAULT_CHANNELS;
    neural->surface = g_new0(guint8, texels * (gsize)neural->n_channels);
    neural->heights = g_new0(guint8, 4 * texels);
    if (geometry && geometry->camera_mm) {
        neural->camera_mm = g_memdup2(geometry->camera_mm, 12 * btf->layout.views.n);
        neural->lamp_mm = g_memdup2(geometry->lamp_mm, 12 * btf->layout.lights.n);
    }
    neural_set_heights(neural, geometry);
    neural_prepare(neural);
    if (!fit(neural, btf, options, error) || !find_errors(neural, btf, &options->work, error))
        g_clear_pointer(&neural, neural_free);
    return neural;
}
