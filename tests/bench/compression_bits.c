#include "compression_parts.h"

#include "bench.h"
#include "codecs/lpca/lpca_private.h"

#include <math.h>
#include <string.h>

/* Bits of a code of fixed length for steps of −most … most. */
static int bits_length(double most, double step) {
    const double steps = ceil(most / step - 0.5);
    return steps < 1 ? 0 : (int)ceil(log2(2 * steps + 1));
}

static float bits_round(float value, double step) {
    return (float)(rint((double)value / step) * step);
}

/* Component i (from 1) of cluster k: rounds weights and eigen-BRDF and returns their bits. With one
 * step for U = w / √D and T = σ E, D values long, σ the RMS of w, either adds step² / 12 to the
 * mean square error of a value. Lengths are those of the component (U), and of it and a light (T).
 */
static double bits_component(struct lpca *lpca, int k, int i, double step) {
    const int n = (int)btf_layout_texels(&lpca->layout), c = lpca->n_components;
    const gsize n_lights = lpca->layout.lights.n, n_views = lpca->layout.views.n;
    const double scale = sqrt(3.0 * (double)(n_views * n_lights)) * step;
    float *brdf = lpca_brdf(lpca, k, i);
    double most = 0, squares = 0, bits = 0;
    int members = 0;
    for (int x = 0; x < n; x++)
        if (lpca->clusters[x] == k) {
            const double w = (double)lpca->weights[(gsize)x * (gsize)c + (gsize)i - 1];
            most = MAX(most, fabs(w));
            squares += w * w;
            members++;
        }
    const double sigma = members > 0 ? sqrt(squares / members) : 0;
    const int length = sigma > 0 ? bits_length(most, scale) : 0;
    for (gsize light = 0; light < n_lights; light++) {
        double largest = 0;
        for (gsize j = 0; j < 3 * n_views; j++)
            largest =
                MAX(largest, fabs((double)brdf[(j / 3 * n_lights + light) * 3 + j % 3]) * sigma);
        const int of_light = length > 0 ? bits_length(largest, step) : 0;
        bits += of_light * 3.0 * (double)n_views;
        for (gsize j = 0; j < 3 * n_views; j++) {
            float *value = &brdf[(j / 3 * n_lights + light) * 3 + j % 3];
            *value = of_light > 0 ? bits_round(*value, step / sigma) : 0;
        }
    }
    for (int x = 0; x < n; x++)
        if (lpca->clusters[x] == k) {
            float *w = &lpca->weights[(gsize)x * (gsize)c + (gsize)i - 1];
            *w = length > 0 && bits > 0 ? bits_round(*w, scale) : 0;
        }
    return bits > 0 ? bits + length * (double)members : 0;
}

/* Bytes; means are halves. ret_kept: components of a texel, on average. */
static double bits_quantise(struct lpca *lpca, double step, double *ret_kept) {
    const double n = (double)btf_layout_texels(&lpca->layout);
    double bits = n * ceil(log2(lpca->n_clusters)), kept = 0;
    for (int k = 0; k < lpca->n_clusters; k++) {
        bits += 16.0 * (double)btf_layout_values(&lpca->layout);
        for (int i = 1; i <= lpca->n_components; i++) {
            const double of_component = bits_component(lpca, k, i, step);
            bits += of_component;
            kept += of_component > 0;
        }
    }
    *ret_kept = kept / lpca->n_clusters;
    return bits / 8;
}

/* All components up to a number, rounded to a step, for several of both. */
static gboolean bits_add(GArray *points, const struct btf_matrix *noisy,
                         const struct btf_matrix *quiet, int k, GError **error) {
    static const int kept_of[] = {16, 32, 48, 64, 96, 128, 192};
    const gsize n = (gsize)btf_matrix_bytes(&noisy->layout) / sizeof(float);
    const int most = k == 1 ? 192 : 64;
    const struct lpca_options options = {.n_clusters = k, .n_components = most, .to_pack = k == 1};
    double squares = 0;
    struct lpca *exact = lpca_compute(noisy, &options, error);
    for (gsize i = 0; i < n; i++)
        squares += (double)noisy->values[i] * noisy->values[i] / (double)n;
    for (gsize c = 0; exact && c < G_N_ELEMENTS(kept_of) && kept_of[c] <= most; c++)
        for (double step = 0.02; step > 0.001; step /= 2) {
            struct lpca *lpca = lpca_truncated(exact, kept_of[c]);
            struct bench_point point = {0};
            double kept;
            point.bytes = bits_quantise(lpca, step * sqrt(squares), &kept);
            point.label = g_strdup_printf("%d x %.1f, step %g", k, kept, step);
            point.error = lpca_error(lpca, quiet, 0);
            g_array_append_val(points, point);
            lpca_free(lpca);
        }
    lpca_free(exact);
    return exact != NULL;
}

static void bits_measure(const struct btf_matrix *noisy, const struct btf_matrix *quiet,
                         GError **error) {
    GArray *points = g_array_new(FALSE, FALSE, sizeof(struct bench_point));
    if (!bits_add(points, noisy, quiet, 1, error) || !bits_add(points, noisy, quiet, 4, error))
        return;
    bench_keep_best(points);
    for (guint k = 0; k < points->len; k++) {
        const struct bench_point *point = &g_array_index(points, struct bench_point, k);
        bench_row(NULL, "%-12s{material} %-24s{label} %.1f{ratio} %.5f{error}", noisy->name,
                  point->label, (double)btf_matrix_bytes(&noisy->layout) / 2 / point->bytes,
                  point->error);
        g_free(point->label);
    }
    g_array_unref(points);
}

int bench_bits(char *const *sessions, int every) {
    return bench_pairs(sessions, every, "--bits", "points", bits_measure);
}
