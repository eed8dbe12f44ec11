#include "neural_fixture.h"

#include "btf_fixture.h"

#include <math.h>

static void randomise(GRand *random, guint8 *bytes, gsize n) {
    for (gsize i = 0; i < n; i++)
        bytes[i] = (guint8)g_rand_int_range(random, 0, 256);
}

/* Sets scales of values −size … size. */
static void scale(struct neural_scale *scales, int n, double size) {
    for (int k = 0; k < n; k++)
        scales[k] = (struct neural_scale){(float)(-size * (1 + 0.01 * k)), (float)(size / 127)};
}

struct neural *neural_fixture_new(int width, int height, int n_channels, double depth_mm,
                                  guint32 seed) {
    struct neural *ret = g_new0(struct neural, 1);
    GRand *random = g_rand_new_with_seed(seed);
    ret->name = g_strdup("gravel");
    ret->layout = (struct btf_layout){.width = (gsize)width,
                                      .height = (gsize)height,
                                      .texel_mm = 0.5,
                                      .reference_mm = 3,
                                      .views = btf_fixture_two_rings(0),
                                      .lights = btf_fixture_two_rings(20)};
    ret->n_channels = n_channels;
    ret->surface = g_new(guint8, width * height * n_channels);
    ret->heights = g_new(guint8, 4 * width * height);
    randomise(random, ret->surface, (gsize)width * (gsize)height * (gsize)n_channels);
    randomise(random, ret->halves, sizeof ret->halves);
    randomise(random, ret->differences, sizeof ret->differences);
    randomise(random, ret->weights, sizeof ret->weights);
    /* Hills, which repeat across the sample, and some roughness. */
    for (int i = 0; i < 4 * width * height; i++) {
        const int row = i / (2 * width), column = i % (2 * width);
        const double x = 2 * G_PI * column / width, y = 2 * G_PI * row / height;
        const double hill = 0.45 * (sin(x) * cos(y) + 1) + g_rand_double_range(random, 0, 0.1);
        ret->heights[i] = (guint8)(255 * hill);
    }
    scale(ret->surface_scales, NEURAL_MAX_CHANNELS, 0.8);
    scale(ret->half_scales, NEURAL_PLANE_CHANNELS, 0.7);
    scale(ret->difference_scales, NEURAL_PLANE_CHANNELS, 0.9);
    scale(ret->rows, NEURAL_ROWS, 0.3);
    for (int k = 0; k < NEURAL_ROWS; k++)
        ret->biases[k] = (float)g_rand_double_range(random, -0.3, 0.6);
    ret->height_scale = (struct neural_scale){(float)(-0.1 - depth_mm), (float)(depth_mm / 255)};
    g_rand_free(random);
    neural_prepare(ret);
    return ret;
}

/* A bilinear read of channel k of a plane of bytes at the texture coordinates (u, v), without the
 * scale. The plane repeats, or is clamped to the edge. */
static double read_at(const guint8 *plane, int columns, int rows, int channels, int k,
                      gboolean repeats, double u, double v) {
    const double x = u * columns - 0.5, y = v * rows - 0.5;
    double sum = 0;
    for (int corner = 0; corner < 4; corner++) {
        const double i = floor(x) + (corner & 1), j = floor(y) + (corner & 2 ? 1 : 0);
        const double share = (1 - fabs(x - i)) * (1 - fabs(y - j));
        const double row_of = repeats ? j - rows * floor(j / rows) : CLAMP(j, 0, rows - 1);
        const double column_of =
            repeats ? i - columns * floor(i / columns) : CLAMP(i, 0, columns - 1);
        const int row = (int)row_of, column = (int)column_of;
        sum += share * plane[(row * columns + column) * channels + k];
    }
    return sum;
}

static double scaled(struct neural_scale scale, double byte) {
    return (double)scale.minimum + (double)scale.step * byte;
}

static double height_at(const struct neural *m, gboolean point, double x, double y) {
    const int w = (int)m->layout.width, h = (int)m->layout.height;
    return scaled(m->height_scale, read_at(m->heights, 2 * w, 2 * h, 1, 0, point, x / w, y / h)) /
           m->layout.texel_mm;
}

static void end_of(const struct neural *m, gboolean point, double x, double y, const double v[3],
                   double ret[2]) {
    const double top = scaled(m->height_scale, 255) / m->layout.texel_mm;
    const double bottom = scaled(m->height_scale, 0) / m->layout.texel_mm;
    const double wx = v[0] / fmax(v[2], 0.05), wy = -v[1] / fmax(v[2], 0.05);
    /* The number of steps is rounded up. It must not depend on the last digit. */
    const float steps = ceilf((float)(4 * (top - bottom) * fmax(1, hypot(wx, wy))));
    const int n = CLAMP((int)steps, 1, 64);
    int k = 0;
    while (height_at(m, point, x + wx * (top - (top - bottom) * k / n),
                     y + wy * (top - (top - bottom) * k / n)) < top - (top - bottom) * k / n)
        k++;
    double low = top - (top - bottom) * k / n, high = top - (top - bottom) * MAX(k - 1, 0) / n;
    for (int i = 0; i < 5; i++) {
        const double middle = (low + high) / 2;
        const gboolean under = height_at(m, point, x + wx * middle, y + wy * middle) >= middle;
        low = under ? middle : low;
        high = under ? high : middle;
    }
    ret[0] = x + wx * low;
    ret[1] = y + wy * low;
}

static void light_at(const struct neural *m, gboolean point, double x, double y, const double l[3],
                     double inputs[3]) {
    const double top = scaled(m->height_scale, 255) / m->layout.texel_mm;
    const double bottom = scaled(m->height_scale, 0) / m->layout.texel_mm;
    const double c = fmax(hypot(l[0], l[1]), 1e-4), r = l[2] / c, z = height_at(m, point, x, y);
    double highest = r - 1, t = 0.375;
    for (int k = 0; k < 64 && t <= (top - bottom) / fmax(r, 0.05) + 0.5 && top - z > highest * t;
         k++) {
        const double there = height_at(m, point, x + l[0] / c * t, y - l[1] / c * t);
        highest = fmax(highest, (there - z) / t);
        t += fmax(0.25, t / 16);
    }
    double s = 0, down = 0; /* slopes along x and y */
    for (int corner = 0; corner < 4; corner++) {
        const double right = corner % 2 ? 0.375 : -0.375, below = corner / 2 ? 0.375 : -0.375;
        const double there = height_at(m, point, x + right, y + below);
        s += there * (right > 0 ? 1 : -1) / 1.5;
        down += there * (below > 0 ? 1 : -1) / 1.5;
    }
    const double cosine = (l[2] - s * l[0] + down * l[1]) / sqrt(1 + s * s + down * down);
    const double clear = CLAMP(r - highest, -1, 1), lit = CLAMP(0.5 + 10 * clear, 0, 1);
    inputs[0] += fmax(cosine, 0) * lit;
    inputs[1] += lit;
    inputs[2] += clear;
}

static double soft(double y) {
    return log1p(exp(4 * y)) / 4;
}

static void formula(const struct neural *m, gboolean point, double x, double y, const double v[3],
                    const double l[3], double ret[3]) {
    const int channels = m->n_channels, n_inputs = channels + 19, rays = point ? 1 : 4;
    const int w = (int)m->layout.width, h = (int)m->layout.height;
    double values[3][NEURAL_MAX_INPUTS] = {{0}}, *inputs = values[0];
    for (int ray = 0; ray < rays; ray++) {
        const double apart = point ? 0 : 0.25;
        double end[2];
        end_of(m, point, x + (ray % 2 ? apart : -apart), y + (ray / 2 ? apart : -apart), v, end);
        for (int k = 0; k < channels; k++)
            inputs[k] += scaled(m->surface_scales[k], read_at(m->surface, w, h, channels, k, point,
                                                              end[0] / w, end[1] / h));
        light_at(m, point, end[0], end[1], l, inputs + channels + 16);
    }
    for (int k = 0; k < n_inputs; k++)
        inputs[k] /= rays;
    double g[3] = {v[0] + l[0], v[1] + l[1], v[2] + l[2]};
    const double length = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    for (int i = 0; i < 3; i++)
        g[i] /= length;
    const double scale = (l[0] * g[0] + l[1] * g[1]) / (1 + g[2]) + l[2];
    for (int k = 0; k < 8; k++) {
        inputs[channels + k] = scaled(m->half_scales[k], read_at(m->halves, 8, 8, 8, k, FALSE,
                                                                 (g[0] + 1) / 2, (g[1] + 1) / 2));
        inputs[channels + 8 + k] =
            scaled(m->difference_scales[k],
                   read_at(m->differences, 8, 8, 8, k, FALSE, (l[0] - g[0] * scale + 1) / 2,
                           (l[1] - g[1] * scale + 1) / 2));
    }
    const guint8 *weight = m->weights;
    double outputs[6] = {0};
    for (int row = 0; row < 70; row++) {
        const int layer = MIN(row / 32, 2), n = layer == 0 ? n_inputs : 32;
        double sum = (double)m->biases[row];
        for (int i = 0; i < n; i++)
            sum += scaled(m->rows[row], *weight++) * values[layer][i];
        if (layer < 2)
            values[layer + 1][row % 32] = sum > 0 ? sum : 0.01 * sum;
        else
            outputs[row - 64] = sum;
    }
    for (int c = 0; c < 3; c++)
        ret[c] = soft(outputs[c]) * inputs[channels + 16] + 0.3 * soft(outputs[3 + c] - 1);
}

void neural_formula(const struct neural *neural, double x, double y, const double view[3],
                    const double light[3], double ret[3]) {
    formula(neural, FALSE, x, y, view, light, ret);
}

void neural_formula_point(const struct neural *neural, double x, double y, const double view[3],
                          const double light[3], double ret[3]) {
    formula(neural, TRUE, x, y, view, light, ret);
}
