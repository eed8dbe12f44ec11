#include "neural_drawing.h"

#include "base/work.h"
#include "btf/direction_grid.h"

#include <math.h>

#define GROUP   4 /* number of channels of a texture, and of rows and columns of a matrix */
#define COLOURS 3 /* number of rows of a group of the third layer */
/* number of lights that stand for the uniform sky, in each of two dimensions */
#define SKY_LIGHTS 4
#define SKY_TEXELS 40000 /* maximum number of texels for which the uniform sky is computed */

static const char *const ordinals[NEURAL_LAYERS] = {"FIRST", "SECOND", "THIRD"};

static float scaled(const struct neural_scale *scale, int byte) {
    return scale->minimum + scale->step * (float)byte;
}

/* A layer of the network. first_row is the index of the layer's first row among the rows of all
 * layers. weights are the bytes of the layer's weights. */
struct layer {
    int first_row, n_rows, n_inputs;
    const guint8 *weights;
};

static struct layer layer_of(const struct neural *neural, int number) {
    const int inputs = neural_inputs(neural->n_channels);
    const int before[] = {0, NEURAL_HIDDEN * inputs, NEURAL_HIDDEN * (inputs + NEURAL_HIDDEN)};
    return (struct layer){NEURAL_HIDDEN * number,
                          number == NEURAL_LAYERS - 1 ? NEURAL_OUTPUTS : NEURAL_HIDDEN,
                          number == 0 ? inputs : NEURAL_HIDDEN, neural->weights + before[number]};
}

/* Returns the index of a row in its layer. The row is given by its group and by its place within
 * the group. Returns −1 if the group has no row at this place. */
static int row_at(const struct layer *layer, int group, int place) {
    const int apart = layer->n_rows == NEURAL_OUTPUTS ? COLOURS : GROUP;
    return place < apart ? group * apart + place : -1;
}

static float weight_at(const struct neural *neural, const struct layer *layer, int row, int input) {
    if (row < 0 || input >= layer->n_inputs)
        return 0;
    return scaled(&neural->rows[layer->first_row + row],
                  layer->weights[row * layer->n_inputs + input]);
}

/* Returns the bias of a row. In the first layer, the bias includes the minima of the surface's
 * channels. */
static float bias_at(const struct neural *neural, const struct layer *layer, int row) {
    if (row < 0)
        return 0;
    float bias = neural->biases[layer->first_row + row];
    for (int k = 0; layer->first_row == 0 && k < neural->n_channels; k++)
        bias += weight_at(neural, layer, row, k) * neural->surface_scales[k].minimum;
    return bias;
}

static void append(GString *text, const char *type, const float *values, int n, gboolean first) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(text, "%s%s(", first ? " " : ", ", type);
    for (int k = 0; k < n; k++)
        g_string_append_printf(text, "%s%s", k > 0 ? "," : "",
                               g_ascii_formatd(number, sizeof number, "%.8e", (double)values[k]));
    g_string_append_c(text, ')');
}

static void append_layer(GString *text, const struct neural *neural, int number) {
    const struct layer layer = layer_of(neural, number);
    const int groups = layer.n_rows == NEURAL_OUTPUTS ? 2 : NEURAL_HIDDEN / GROUP;
    const int columns = (layer.n_inputs + GROUP - 1) / GROUP;
    g_string_append_printf(text, "#define %s_WEIGHTS", ordinals[number]);
    for (int i = 0; i < groups * columns; i++) {
        float matrix[GROUP * GROUP];
        for (int k = 0; k < GROUP * GROUP; k++)
            matrix[k] = weight_at(neural, &layer, row_at(&layer, i / columns, k % GROUP),
                                  i % columns * GROUP + k / GROUP) *
                        (number == 0 && i % columns * GROUP < neural->n_channels
                             ? 255 * neural->surface_scales[i % columns * GROUP + k / GROUP].step
                             : 1);
        append(text, "mat4", matrix, GROUP * GROUP, i == 0);
    }
    g_string_append_printf(text, "\n#define %s_BIASES", ordinals[number]);
    for (int i = 0; i < groups; i++) {
        float biases[GROUP];
        for (int k = 0; k < GROUP; k++)
            biases[k] = bias_at(neural, &layer, row_at(&layer, i, k));
        append(text, "vec4", biases, GROUP, i == 0);
    }
    g_string_append_c(text, '\n');
}

char *neural_shader_network(const struct neural *neural) {
    GString *text = g_string_new(NULL);
    for (int k = 0; k < NEURAL_LAYERS; k++)
        append_layer(text, neural, k);
    return g_string_free(text, FALSE);
}

void neural_shader_planes(const struct neural *neural, float *ret) {
    const int cells = NEURAL_PLANE * NEURAL_PLANE;
    for (int i = 0; i < NEURAL_PLANE_LAYERS * cells * GROUP; i++) {
        const int layer = i / (cells * GROUP), channel = layer % 2 * GROUP + i % GROUP;
        const int at = i / GROUP % cells * NEURAL_PLANE_CHANNELS + channel;
        ret[i] = layer < 2 ? scaled(&neural->half_scales[channel], neural->halves[at])
                           : scaled(&neural->difference_scales[channel], neural->differences[at]);
    }
}

/* The reflectance of a row of texels under the uniform sky, in one of the views. */
struct sky {
    const struct neural *neural;
    float *values;
};

/* Returns the height at the centre of a texel, in texels. */
static float height_of(const struct neural *neural, gsize row, gsize column) {
    const gsize columns = 2 * neural->layout.width;
    const guint8 *at = neural->heights + 2 * row * columns + 2 * column;
    const float byte = 0.25F * (float)(at[0] + at[1] + at[columns] + at[columns + 1]);
    return (neural->height_scale.minimum + neural->height_scale.step * byte) /
           (float)neural->layout.texel_mm;
}

/* Gives the direction at the middle of a cell of the square. */
static void view_of(gsize cell, float ret[3]) {
    const gsize row = cell / NEURAL_SKY, column = cell % NEURAL_SKY;
    const float s = ((float)column + 0.5F) / NEURAL_SKY * 2 - 1;
    const float t = ((float)row + 0.5F) / NEURAL_SKY * 2 - 1;
    const float x = 0.5F * (s + t), y = 0.5F * (s - t), z = 1 - fabsf(x) - fabsf(y);
    const float length = sqrtf(x * x + y * y + z * z);
    ret[0] = x / length;
    ret[1] = y / length;
    ret[2] = z / length;
}

static void compute_row(int block, gpointer data) {
    const struct sky *sky = data;
    const gsize width = sky->neural->layout.width, height = sky->neural->layout.height;
    const gsize row = (gsize)block % height, n_lights = (gsize)SKY_LIGHTS * SKY_LIGHTS;
    g_autofree struct neural_sample *samples = g_new(struct neural_sample, width * n_lights);
    g_autofree float *colours = g_new(float, 3 * width * n_lights);
    float v[3];
    view_of((gsize)block / height, v);
    for (gsize i = 0; i < width * n_lights; i++) {
        const gsize column = i / n_lights, light = i % n_lights;
        const gsize from_row = light / SKY_LIGHTS, from_column = light % SKY_LIGHTS;
        const float z = height_of(sky->neural, row, column);
        samples[i] = (struct neural_sample){.x = (float)column + 0.5F - v[0] / v[2] * z,
                                            .y = (float)row + 0.5F + v[1] / v[2] * z,
                                            .view = {v[0], v[1], v[2]}};
        direction_grid_direction(((double)from_column + 0.5) / SKY_LIGHTS,
                                 ((double)from_row + 0.5) / SKY_LIGHTS, samples[i].light);
    }
    neural_evaluate_points(sky->neural, samples, width * n_lights, colours);
    float *ret = sky->values + 3 * (gsize)block * width;
    for (gsize i = 0; i < 3 * width * n_lights; i++)
        ret[3 * (i / (3 * n_lights)) + i % 3] += colours[i] * 2 / (float)n_lights;
}

float *neural_shader_sky(const struct neural *neural, int *ret_width, int *ret_height) {
    const gsize texels = btf_layout_texels(&neural->layout);
    if (texels > SKY_TEXELS) {
        struct neural *half = neural_halved(neural);
        float *values = neural_shader_sky(half, ret_width, ret_height);
        neural_free(half);
        return values;
    }
    const int views = NEURAL_SKY * NEURAL_SKY;
    struct sky sky = {neural, g_new0(float, 3 * (gsize)views * texels)};
    *ret_width = (int)neural->layout.width;
    *ret_height = (int)neural->layout.height;
    work_for_each(0, views * *ret_height, compute_row, &sky);
    return sky.values;
}
