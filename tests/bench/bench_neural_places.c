/*
 * How should a renderer evaluate neural planes at a pixel? Compares the ways with a capture that
 * has smaller texels than the model (NAME_fine of capture_materials), for pixels of half a texel to
 * four texels. The capture gives the mean over each pixel. Pixels of one texel and less read the
 * model, larger ones its mip levels.
 *
 *   texel   four rays around the place, as neural_evaluate() takes them
 *   point   one ray at the place
 *   mix     texels interpolated: the mean of the colours of the four texels around the place
 *
 * The error is relative to the capture, as an RMS. `change` is how much the picture changes if it
 * moves by half a texel of the model, as an RMS relative to the change of the capture. A picture
 * with aliasing changes more than the capture does.
 */
#include "bench.h"
#include "codecs/codec/codec_geometry.h"
#include "codecs/neural/neural.h"
#include "metrics/delta_e.h"

#include <math.h>
#include <string.h>

#define COLOURS 3
#define MARGIN  8 /* texels of the model at the edges that are left out */
#define LEVELS  3

enum { CAPTURE, TEXEL, POINT, MIX, N_WAYS };
static const char *const way_names[] = {"capture", "texel", "point", "mix"};

struct places {
    const struct btf_matrix *fine;
    const struct codec_geometry *geometry;
    struct neural *levels[LEVELS];
};

/* The pixels of a picture: `size` texels of the capture on a side, moved by `shift` of them. */
struct pixels {
    int size, shift, first, n; /* first pixel, and number of pixels, in each dimension */
};

/* The mean of the capture over a pixel. */
static void capture_pixel(const struct places *places, const struct pixels *pixels, int row,
                          int column, gsize pair, float ret[COLOURS]) {
    const struct btf_layout *layout = &places->fine->layout;
    const gsize pairs = layout->views.n * layout->lights.n;
    const int n = pixels->size * pixels->size;
    memset(ret, 0, COLOURS * sizeof *ret);
    for (int i = 0; i < n; i++) {
        const int y = row * pixels->size + i / pixels->size;
        const int x = column * pixels->size + pixels->shift + i % pixels->size;
        const gsize texel = (gsize)y * layout->width + (gsize)x;
        for (gsize c = 0; c < COLOURS; c++)
            ret[c] += places->fine->values[(texel * pairs + pair) * COLOURS + c] / (float)n;
    }
}

static void set_sample(const struct places *places, const struct neural *level,
                       const struct pixels *pixels, int row, int column, gsize pair,
                       struct neural_sample *ret) {
    const struct btf_layout *layout = &places->fine->layout;
    const float x = ((float)column + 0.5F) * (float)pixels->size + (float)pixels->shift;
    const float y = ((float)row + 0.5F) * (float)pixels->size;
    const int texel = (int)y * (int)layout->width + (int)x;
    const int view = (int)(pair / layout->lights.n), light = (int)(pair % layout->lights.n);
    ret->x = x * (float)level->layout.width / (float)layout->width;
    ret->y = y * (float)level->layout.height / (float)layout->height;
    codec_geometry_towards(layout, places->geometry->camera_mm, &layout->views, view, texel,
                           ret->view);
    codec_geometry_towards(layout, places->geometry->lamp_mm, &layout->lights, light, texel,
                           ret->light);
}

static void mix_texels(const struct neural *level, const struct neural_sample *sample,
                       float ret[COLOURS]) {
    const float left = floorf(sample->x - 0.5F), top = floorf(sample->y - 0.5F);
    const float a = sample->x - 0.5F - left, b = sample->y - 0.5F - top;
    struct neural_sample texels[4];
    float colours[4 * COLOURS];
    memset(ret, 0, COLOURS * sizeof *ret);
    for (int k = 0; k < 4; k++) {
        texels[k] = *sample;
        texels[k].x = left + 0.5F + (float)(k % 2);
        texels[k].y = top + 0.5F + (float)(k / 2);
    }
    neural_evaluate(level, texels, 4, colours);
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < COLOURS; c++)
            ret[c] += (k % 2 ? a : 1 - a) * (k / 2 ? b : 1 - b) * colours[COLOURS * k + c];
}

/* Draws a picture in one of the ways: n × n × R, G, B. */
static void draw(const struct places *places, const struct neural *level,
                 const struct pixels *pixels, gsize pair, int way, float *ret) {
    const int n = pixels->n * pixels->n;
    struct neural_sample *samples = g_new0(struct neural_sample, n);
    for (int i = 0; i < n; i++) {
        const int row = pixels->first + i / pixels->n, column = pixels->first + i % pixels->n;
        if (way == CAPTURE)
            capture_pixel(places, pixels, row, column, pair, ret + COLOURS * i);
        set_sample(places, level, pixels, row, column, pair, &samples[i]);
        if (way == MIX)
            mix_texels(level, &samples[i], ret + COLOURS * i);
    }
    if (way == TEXEL)
        neural_evaluate(level, samples, (gsize)n, ret);
    if (way == POINT)
        neural_evaluate_points(level, samples, (gsize)n, ret);
    g_free(samples);
}

static double squares(const float *a, const float *b, gsize n) {
    double sum = 0;
    for (gsize i = 0; i < n; i++)
        sum += isfinite(a[i]) && (!b || isfinite(b[i]))
                   ? pow((double)a[i] - (b ? (double)b[i] : 0), 2)
                   : 0;
    return sum;
}

static double sum_delta_e(const float *a, const float *b, int pixels) {
    double sum = 0;
    for (int i = 0; i < pixels; i++) {
        double lab[2][3];
        delta_e_lab(a + COLOURS * i, lab[0]);
        delta_e_lab(b + COLOURS * i, lab[1]);
        sum += delta_e_2000(lab[0], lab[1]);
    }
    return sum;
}

/* Compares all pictures of pixels of `size` texels of the capture. */
static void compare(const struct places *places, int size) {
    const struct btf_layout *layout = &places->fine->layout;
    const int ratio = (int)(layout->width / places->levels[0]->layout.width);
    int k = 0;
    while (k + 1 < LEVELS && size >= ratio << (k + 1))
        k++;
    const int first = (MARGIN * ratio + size - 1) / size;
    const int n = ((int)layout->width - MARGIN * ratio) / size - first;
    const struct pixels still = {size, 0, first, n}, moved = {size, ratio / 2, first, n};
    const gsize values = (gsize)COLOURS * (gsize)n * (gsize)n;
    double off[N_WAYS] = {0}, changes[N_WAYS] = {0}, delta_e[N_WAYS] = {0}, all = 0;
    const gsize pairs = layout->views.n * layout->lights.n;
    float *pictures[N_WAYS];
    g_autofree float *other = g_new(float, values);
    for (int way = 0; way < N_WAYS; way++)
        pictures[way] = g_new(float, values);
    for (gsize pair = 0; pair < pairs; pair++)
        for (int way = 0; way < N_WAYS; way++) {
            draw(places, places->levels[k], &still, pair, way, pictures[way]);
            draw(places, places->levels[k], &moved, pair, way, other);
            changes[way] += squares(pictures[way], other, values);
            off[way] += squares(pictures[way], pictures[CAPTURE], values);
            delta_e[way] += sum_delta_e(pictures[way], pictures[CAPTURE], n * n);
            all += way == CAPTURE ? squares(pictures[CAPTURE], NULL, values) : 0;
        }
    for (int way = TEXEL; way < N_WAYS; way++)
        bench_row(NULL,
                  "%-6s{way} %.2f{pixel_texels} %d{level} %.2f{error_pct} %.3f{delta_e} "
                  "%.3f{change}",
                  way_names[way], (double)size / ratio, k, 100 * sqrt(off[way] / all),
                  delta_e[way] / (double)pairs / n / n, sqrt(changes[way] / changes[CAPTURE]));
    for (int way = 0; way < N_WAYS; way++)
        g_free(pictures[way]);
}

int main(int argc, char **argv) {
    const GOptionEntry entries[] = {{NULL}};
    g_autoptr(GError) error = NULL;
    struct places places = {0};
    bench_parse(&argc, &argv, entries, "neural.exr DIR");
    if (argc != 3)
        bench_fail(2, "give a model, and the session of the same sample with smaller texels");
    places.levels[0] = neural_read(argv[1], &error);
    bench_check(error);
    struct btf_matrix *fine = btf_matrix_read(argv[2], NULL, &error);
    bench_check(error);
    const int width = (int)places.levels[0]->layout.width;
    if (fine->layout.width % (2 * (gsize)width) != 0)
        bench_fail(2, "the texels of the session are not half as large, or a fourth, and so on");
    struct codec_geometry *geometry = codec_geometry_read(fine, &error);
    bench_check(error);
    places.fine = fine;
    places.geometry = geometry;
    for (int k = 1; k < LEVELS; k++)
        places.levels[k] = neural_halved(places.levels[k - 1]);
    bench_begin(NULL);
    bench_begin_list("ways");
    for (int size = 1; size <= 4 * (int)fine->layout.width / width; size *= 2)
        compare(&places, size);
    bench_end();
    bench_end();
    for (int k = 0; k < LEVELS; k++)
        neural_free(places.levels[k]);
    codec_geometry_free(geometry);
    btf_matrix_free(fine);
    return 0;
}
