#include "compression_parts.h"

#include "bench.h"
#include "codecs/eigenmaps/eigenmaps_codec.h"

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

int bench_eigenmaps(struct btf_matrix *like, BenchValue value, int columns) {
    g_autoptr(GError) error = NULL;
    double exact_s, randomised_s, exact, randomised;
    /* The sparing one first: memory only ever grows. */
    if (bench_fill(like, value, &error) &&
        measure(like, EIGENMAPS_RANDOMISED, columns, &randomised_s, &randomised, &error)) {
        const double peak = bench_peak_mib();
        if (measure(like, EIGENMAPS_EXACT, columns, &exact_s, &exact, &error)) {
            bench_begin(NULL);
            bench_put("%zu{rows} %zu{views} %d{columns_in_memory} %d{terms} %.2f{exact_cpu_s} "
                      "%.7f{exact_error} %.2f{randomised_cpu_s} %.7f{randomised_error} "
                      "%.2f{faster} %.0f{peak_mib}",
                      btf_layout_texels(&like->layout) * like->layout.lights.n * 3,
                      like->layout.views.n, columns, TERMS, exact_s, exact, randomised_s,
                      randomised, exact_s / randomised_s, peak);
            bench_end();
        }
    }
    bench_check(error);
    return 0;
}
