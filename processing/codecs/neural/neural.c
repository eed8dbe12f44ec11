#include "neural_private.h"

#include "codecs/codec/codec_geometry.h"

#include <math.h>
#include <string.h>

void neural_free(struct neural *neural) {
    if (!neural)
        return;
    g_free(neural->name);
    btf_layout_clear(&neural->layout);
    g_free(neural->surface);
    g_free(neural->heights);
    g_free(neural->camera_mm);
    g_free(neural->lamp_mm);
    neural_numbers_free(neural->numbers);
    g_free(neural);
}

int neural_inputs(int n_channels) {
    return n_channels + 2 * NEURAL_PLANE_CHANNELS + NEURAL_LIGHT_INPUTS;
}

int neural_weights(int n_channels) {
    return NEURAL_HIDDEN * (neural_inputs(n_channels) + NEURAL_HIDDEN + NEURAL_OUTPUTS);
}

gint64 neural_bytes(const struct neural *neural) {
    const gint64 texels = (gint64)btf_layout_texels(&neural->layout);
    const gint64 scales = neural->n_channels + 1 + 2 * NEURAL_PLANE_CHANNELS;
    const gint64 shared = 2 * NEURAL_PLANE_VALUES + neural_weights(neural->n_channels) +
                          (gint64)sizeof(float) * (3 * NEURAL_ROWS + 2 * scales);
    return texels * (neural->n_channels + 4) + (neural->level == 0 ? shared : 0);
}

struct neural_numbers *neural_numbers_new(int width, int height, int n_channels) {
    struct neural_numbers *numbers = g_new0(struct neural_numbers, 1);
    const gsize texels = (gsize)width * (gsize)height;
    numbers->width = width;
    numbers->height = height;
    numbers->n_channels = n_channels;
    numbers->surface = g_new0(float, texels *(gsize)n_channels);
    numbers->heights = g_new0(float, (2 * (gsize)width + 1) * (2 * (gsize)height + 1));
    return numbers;
}

void neural_numbers_free(struct neural_numbers *numbers) {
    if (!numbers)
        return;
    g_free(numbers->surface);
    g_free(numbers->heights);
    g_free(numbers);
}

/* Decodes n elements of n_scales channels each. */
static void decode(const guint8 *bytes, gsize n, const struct neural_scale *scales, gsize n_scales,
                   float *ret) {
    for (gsize i = 0; i < n; i++)
        for (gsize k = 0; k < n_scales; k++)
            ret[i * n_scales + k] = scales[k].minimum + scales[k].step * bytes[i * n_scales + k];
}

/* Decodes the heights. Copies of the first row and column follow the last row and column. */
static void decode_heights(const struct neural *neural, const struct neural_scale *scale,
                           float *ret) {
    const gsize columns = 2 * neural->layout.width, rows = 2 * neural->layout.height;
    for (gsize row = 0; row <= rows; row++) {
        const guint8 *from = neural->heights + row % rows * columns;
        float *to = ret + row * (columns + 1);
        decode(from, columns, scale, 1, to);
        to[columns] = to[0];
    }
}

void neural_prepare(struct neural *neural) {
    const int channels = neural->n_channels, inputs = neural_inputs(channels);
    const gsize texels = btf_layout_texels(&neural->layout);
    const gsize plane = (gsize)NEURAL_PLANE * NEURAL_PLANE;
    const float texel_mm = (float)neural->layout.texel_mm;
    const struct neural_scale height = {neural->height_scale.minimum / texel_mm,
                                        neural->height_scale.step / texel_mm};
    neural_numbers_free(neural->numbers);
    struct neural_numbers *to = neural->numbers =
        neural_numbers_new((int)neural->layout.width, (int)neural->layout.height, channels);
    decode(neural->surface, texels, neural->surface_scales, (gsize)channels, to->surface);
    decode_heights(neural, &height, to->heights);
    to->bottom = height.minimum;
    to->top = height.minimum + height.step * 255;
    decode(neural->halves, plane, neural->half_scales, NEURAL_PLANE_CHANNELS, to->halves);
    decode(neural->differences, plane, neural->difference_scales, NEURAL_PLANE_CHANNELS,
           to->differences);
    const guint8 *weights = neural->weights;
    float *ret = to->weights;
    for (int row = 0; row < NEURAL_ROWS; row++) {
        const int n = row < NEURAL_HIDDEN ? inputs : NEURAL_HIDDEN;
        decode(weights, (gsize)n, &neural->rows[row], 1, ret);
        weights += n;
        ret += n;
    }
    memcpy(to->biases, neural->biases, sizeof to->biases);
}

void neural_view(const struct neural *neural, int view, int texel, float ret[3]) {
    codec_geometry_towards(&neural->layout, neural->camera_mm, &neural->layout.views, view, texel,
                           ret);
}

void neural_light(const struct neural *neural, int light, int texel, float ret[3]) {
    codec_geometry_towards(&neural->layout, neural->lamp_mm, &neural->layout.lights, light, texel,
                           ret);
}

/* Reduces bytes (columns × rows × channels) to to_columns × to_rows, half the size. A new element
 * is the mean of the elements that it overlaps, weighted by the overlaps. */
static void halve(const guint8 *from, gsize columns, gsize rows, gsize n_channels, guint8 *ret,
                  gsize to_columns, gsize to_rows) {
    for (gsize i = 0; i < to_columns * to_rows; i++)
        for (gsize k = 0; k < n_channels; k++) {
            const double x = (double)columns / (double)to_columns,
                         y = (double)rows / (double)to_rows;
            const gsize row = i / to_columns, column = i % to_columns;
            const double left = x * (double)column, top = y * (double)row;
            double sum = 0;
            for (gsize b = (gsize)top; b < rows && (double)b < top + y - 1e-9; b++)
                for (gsize a = (gsize)left; a < columns && (double)a < left + x - 1e-9; a++) {
                    const double wide = MIN((double)a + 1, left + x) - MAX((double)a, left);
                    const double high = MIN((double)b + 1, top + y) - MAX((double)b, top);
                    sum += wide * high * from[(b * columns + a) * n_channels + k];
                }
            ret[i * n_channels + k] = (guint8)lround(sum / (x * y));
        }
}

struct neural *neural_halved(const struct neural *neural) {
    const struct btf_layout *layout = &neural->layout;
    const gsize width = MAX(1, layout->width / 2), height = MAX(1, layout->height / 2);
    if (layout->width == 1 && layout->height == 1)
        return NULL;
    struct neural *half = g_memdup2(neural, sizeof *neural);
    half->name = g_strdup(neural->name);
    half->layout = btf_layout_copy(layout);
    half->layout.width = width;
    half->layout.height = height;
    half->layout.texel_mm = layout->texel_mm * (double)layout->width / (double)width;
    half->level = neural->level + 1;
    half->surface = g_new(guint8, width * height * (gsize)neural->n_channels);
    half->heights = g_new(guint8, 4 * width * height);
    half->camera_mm = g_memdup2(neural->camera_mm, sizeof(float) * 3 * layout->views.n);
    half->lamp_mm = g_memdup2(neural->lamp_mm, sizeof(float) * 3 * layout->lights.n);
    half->numbers = NULL;
    halve(neural->surface, layout->width, layout->height, (gsize)neural->n_channels, half->surface,
          width, height);
    halve(neural->heights, 2 * layout->width, 2 * layout->height, 1, half->heights, 2 * width,
          2 * height);
    neural_prepare(half);
    return half;
}
