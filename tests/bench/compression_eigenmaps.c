#include "compression_parts.h"

#include "bench.h"
#include "codecs/eigenmaps/eigenmaps_codec.h"

#include <stdio.h>
#include <time.h>

#define TERMS 4

static gboolean measure(const struct btf_matrix *btf, enum eigenmaps_method method, int columns,
                        double *ret_cpu_s, double *ret_error, GError **error) {
    const gsize column = (gsize)btf_matrix_bytes(&btf->layout) / btf->layout.views.n;
    const struct eigenmaps_options options = {.memory = (gsize)columns * column, .method = method};
    const double begun = (double)clock();
    struct eigenmaps *maps = eigenmaps_of_matrix(btf, TERMS, &options, NULL, ret_error, error);
    *ret_cpu_s = ((double)clock() - begun) / CLOCKS_PER_SEC;
    const gboolean ok = maps != NULL;
    eigenmaps_free(maps);
    return ok;
}

int bench_eigenmaps(struct btf_matrix *like, BenchValue value, int columns, gboolean json) {
    g_autoptr(GError) error = NULL;
    double exact_s, randomised_s, exact, randomised;
    /* The sparing one first: memory only ever grows. */
    if (bench_fill(like, value, &error) &&
        measure(like, EIGENMAPS_RANDOMISED, columns, &randomised_s, &randomised, &error)) {
        const double peak = bench_peak_mib();
        if (measure(like, EIGENMAPS_EXACT, columns, &exact_s, &exact, &error))
            printf(
                json ? "{\"rows\": %zu, \"views\": %zu, \"columns_in_memory\": %d, \"terms\": %d, "
                       "\"exact_cpu_s\": %.2f, \"exact_error\": %.7f, \"randomised_cpu_s\": "
                       "%.2f, \"randomised_error\": %.7f, \"faster\": %.2f, \"peak_mib\": "
                       "%.0f}\n"
                     : "%zu × %zu, of which %d columns in memory, to %d terms: exact %.2f s of "
                       "processors, error %.7f; randomised %.2f s, error %.7f: %.2f times as "
                       "fast; %.0f MiB resident at most\n",
                btf_layout_texels(&like->layout) * like->layout.lights.n * 3, like->layout.views.n,
                columns, TERMS, exact_s, exact, randomised_s, randomised, exact_s / randomised_s,
                peak);
    }
    bench_check(error);
    return 0;
}
