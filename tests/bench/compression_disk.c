#include "compression_parts.h"

#include "bench.h"
#include "codecs/lpca/lpca_private.h"

#include <cblas.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define REDUCED 128 /* as in lpca_compute.c */
#define BLOCK   1024
#define TILE    64 /* texels of a side that are worked out; others repeat them */

double bench_peak_mib(void) {
    g_autofree char *text = NULL;
    g_file_get_contents("/proc/self/status", &text, NULL, NULL);
    const char *line = text ? strstr(text, "VmHWM:") : NULL;
    return line ? g_ascii_strtod(line + strlen("VmHWM:"), NULL) / 1024 : -1;
}

/* By the clock, and of all processors that worked on it: on a busy machine the latter counts. */
struct spent {
    double real_s, cpu_s;
};

static struct spent now(void) {
    return (struct spent){(double)g_get_monotonic_time() / G_USEC_PER_SEC,
                          (double)clock() / CLOCKS_PER_SEC};
}

static struct spent since(struct spent start) {
    const struct spent end = now();
    return (struct spent){end.real_s - start.real_s, end.cpu_s - start.cpu_s};
}

/* What each stage took, told apart by what it says of its progress; before the first it draws. */
#define MAX_STAGES 8
struct stages {
    int n;
    const char *names[MAX_STAGES]; /* interned */
    struct spent starts[MAX_STAGES + 1];
};

static void note(const struct work_progress *progress, gpointer data) {
    struct stages *stages = data;
    const char *name = g_intern_string(progress->stage);
    if (stages->names[stages->n - 1] == name || stages->n == MAX_STAGES)
        return;
    stages->starts[stages->n] = now();
    stages->names[stages->n++] = name;
}

gboolean bench_fill(struct btf_matrix *btf, BenchValue value, GError **error) {
    const int texels = btf_layout_texels(&btf->layout);
    const gsize row = btf->layout.lights.n * 3;
    g_autofree float *view = g_new(float, (gsize)texels *row);
    btf->scratch = btf_scratch_new(g_get_tmp_dir(), row, btf->layout.views.n, texels, error);
    for (gsize v = 0; btf->scratch && v < btf->layout.views.n; v++) {
        for (int x = 0; x < texels; x++) {
            const int i = x % btf->layout.width, j = x / btf->layout.width;
            const int like = j % TILE * btf->layout.width + i % TILE;
            const float bright = 1 - 0.02F * (float)((i / TILE * 5 + j / TILE * 3) % 8);
            for (gsize k = 0; k < row; k++)
                view[(gsize)x * row + k] = like == x ? value(x, v, (int)(k / 3), (int)(k % 3))
                                                     : bright * view[(gsize)like * row + k];
        }
        if (!btf_scratch_write(btf->scratch, v, view, error))
            return FALSE;
    }
    return btf->scratch != NULL;
}

/* Everything a local PCA cannot do without: all is read once, projected, and weighted. */
struct needed {
    const struct btf_matrix *btf;
    int components;
    float *factors; /* (REDUCED + components) × columns of a view */
};

static void needed_block(int block, gpointer data) {
    const struct needed *needed = data;
    const struct btf_matrix *btf = needed->btf;
    const int columns = btf->layout.lights.n * 3, from = block * BLOCK;
    const int n = MIN(BLOCK, btf_layout_texels(&btf->layout) - from),
              outputs = REDUCED + needed->components;
    g_autofree float *buffer = g_new(float, (gsize)n *(gsize)columns);
    g_autofree float *products = g_new0(float, (gsize)n *(gsize)outputs);
    for (gsize view = 0; view < btf->layout.views.n; view++) {
        gsize stride;
        const float *rows = btf_matrix_rows(btf, view, from, n, buffer, &stride, NULL);
        if (!rows)
            return;
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, REDUCED, columns, 1, rows,
                    (int)stride, needed->factors, columns, 1, products, outputs);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, needed->components, columns, 1,
                    rows, (int)stride, needed->factors + (gsize)REDUCED * (gsize)columns, columns,
                    1, products + REDUCED, outputs);
    }
}

static struct spent needed_time(const struct btf_matrix *btf, int components) {
    struct needed needed = {btf, components, NULL};
    const gsize n = (gsize)(REDUCED + components) * btf->layout.lights.n * 3;
    needed.factors = g_new(float, n);
    for (gsize i = 0; i < n; i++)
        needed.factors[i] = (float)(i % 17) - 8;
    const struct spent start = now();
    work_for_each(0, (btf_layout_texels(&btf->layout) + BLOCK - 1) / BLOCK, needed_block, &needed);
    g_free(needed.factors);
    return since(start);
}

static void report(const struct btf_matrix *btf, const struct lpca *lpca,
                   const struct stages *stages, struct spent needed, double peak) {
    const struct spent end = stages->starts[stages->n];
    const struct spent spent = {end.real_s - stages->starts[0].real_s,
                                end.cpu_s - stages->starts[0].cpu_s};
    bench_begin(NULL);
    bench_put("%zu{rows} %zu{columns} %.2f{file_gb} %.2f{seconds} %.2f{needed_seconds} %.2f{ratio} "
              "%.2f{cpu_seconds} %.2f{cpu_ratio} %.0f{peak_mib} %.5f{error}",
              btf_layout_texels(&btf->layout), btf_layout_values(&btf->layout),
              (double)btf_matrix_bytes(&btf->layout) / 2e9, spent.real_s, needed.real_s,
              spent.real_s / needed.real_s, spent.cpu_s, spent.cpu_s / needed.cpu_s, peak,
              lpca->error);
    for (int i = 0; i < stages->n; i++)
        bench_put_double(stages->names[i], "_cpu_s", "%.3f",
                         stages->starts[i + 1].cpu_s - stages->starts[i].cpu_s);
    bench_end();
}

int bench_disk(struct btf_matrix *like, BenchValue value, int clusters, int components) {
    g_autoptr(GError) error = NULL;
    struct stages stages = {.n = 1, .names = {"sample"}};
    const struct lpca_options options = {.n_clusters = clusters,
                                         .n_components = components,
                                         .work.progress = note,
                                         .work.data = &stages};
    struct lpca *lpca = NULL;
    if (bench_fill(like, value, &error)) {
        const struct spent before = needed_time(like, components);
        stages.starts[0] = now();
        lpca = lpca_compute(like, &options, &error);
        stages.starts[stages.n] = now();
        const double peak = bench_peak_mib();
        /* Once more, since the machine may have become busier or less so. */
        if (lpca) {
            const struct spent after = needed_time(like, components);
            const struct spent needed = {(before.real_s + after.real_s) / 2,
                                         (before.cpu_s + after.cpu_s) / 2};
            report(like, lpca, &stages, needed, peak);
        }
    }
    lpca_free(lpca);
    bench_check(error);
    return 0;
}
