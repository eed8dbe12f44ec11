/* Local PCA of a synthetic BTF, or of a BTF in a file of floats: its time, its error, and the rate
 * of its multiplications as a share of the peak rate of sgemm. “error” is the error of the values
 * at the measured directions. “mesorig compare” also gives errors at directions that a method has
 * not seen. Programs in peers/ read the same file. */
#include "bench.h"
#include "codecs/lpca/lpca.h"
#include "compression_parts.h"

#include <cblas.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PEAK    1024 /* rows and columns of the multiplication that shows the peak */
#define REPEATS 5
#define REDUCED 128 /* as in lpca.c */

static int texels = 64, views = 30, lights = 30, clusters = 32, components = 8;
static char *session, *dump;
#ifdef COMPRESS_MPI
static char *ranks;
#endif
static gboolean fields, resample, rate, bits, disk, mdf;
static int fits = 20000, every = 3, eigenmaps;
static const GOptionEntry entries[] = {
    {"session", 's', 0, G_OPTION_ARG_FILENAME, &session, "The BTF of a session", "DIR"},
    {"texels", 't', 0, G_OPTION_ARG_INT, &texels, "Texels of a side, else (64)", "N"},
    {"views", 'v', 0, G_OPTION_ARG_INT, &views, "Views, else (30)", "N"},
    {"lights", 'l', 0, G_OPTION_ARG_INT, &lights, "Lights, else (30)", "N"},
    {"clusters", 'k', 0, G_OPTION_ARG_INT, &clusters, "Clusters (32)", "K"},
    {"components", 'c', 0, G_OPTION_ARG_INT, &components, "Components (8)", "C"},
    {"dump", 'd', 0, G_OPTION_ARG_FILENAME, &dump, "Write the rows as floats, for peers", "FILE"},
    {"fields", 'f', 0, G_OPTION_ARG_NONE, &fields,
     "Models of a texel instead, of the sessions that are named as arguments", NULL},
    {"resample", 'r', 0, G_OPTION_ARG_NONE, &resample,
     "Grids of directions instead: of sessions named as arguments, each followed by the same "
     "material from directions between",
     NULL},
    {"rate", 0, 0, G_OPTION_ARG_NONE, &rate,
     "Error against size instead, beside local PCA as published: of sessions named as arguments, "
     "each followed by the same without noise",
     NULL},
    {"bits", 0, 0, G_OPTION_ARG_NONE, &bits,
     "As --rate, of local PCAs whose components have codes of their own lengths", NULL},
#ifdef COMPRESS_MPI
    {"ranks", 0, 0, G_OPTION_ARG_FILENAME, &ranks,
     "By one, two and four processes instead, of this session", "DIR"},
#endif
    {"disk", 0, 0, G_OPTION_ARG_NONE, &disk,
     "From a file of halves instead, against reading it and two products", NULL},
    {"eigenmaps", 0, 0, G_OPTION_ARG_INT, &eigenmaps,
     "Eigen-maps from a file of halves instead, so many views of which fit into memory: exact and "
     "randomised",
     "N"},
    {"mdf", 0, 0, G_OPTION_ARG_NONE, &mdf,
     "Ways to hold the distances (MDF) of the sessions that are named as arguments instead", NULL},
    {"every", 0, 0, G_OPTION_ARG_INT, &every, "--rate and --bits take every N-th view (3)", "N"},
    {"fits", 0, 0, G_OPTION_ARG_INT, &fits, "Problems of each given to solvers (20000)", "N"},
    {NULL},
};

/* GFLOP/s. */
static double peak(int threads) {
    const gsize n = (gsize)PEAK * PEAK;
    g_autofree float *a = g_new(float, n), *b = g_new(float, n), *c = g_new0(float, n);
    double best = G_MAXDOUBLE;
    for (gsize i = 0; i < n; i++)
        a[i] = b[i] = 1 + (float)(i % 7);
    openblas_set_num_threads(threads);
    for (int i = 0; i < REPEATS; i++) {
        const double start = bench_now_s();
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, PEAK, PEAK, PEAK, 1, a, PEAK, b,
                    PEAK, 0, c, PEAK);
        best = MIN(best, bench_now_s() - start);
    }
    return 2e-9 * PEAK * PEAK * PEAK / best;
}

/* A bumpy, glossy weave: normals and albedo vary with the texel, highlights with the directions. */
static float shade(int texel, int view, int light, int colour) {
    const double x = 0.4 * (texel % texels), y = 0.4 * (texel / texels);
    const double nx = 0.5 * sin(x) * cos(0.5 * y), ny = 0.5 * cos(x) * sin(y);
    const double va = 2.4 * view, la = 2.4 * light;
    const double vr = 0.9 * sqrt((view + 0.5) / views), lr = 0.9 * sqrt((light + 0.5) / lights);
    const double vz = sqrt(1 - vr * vr), lz = sqrt(1 - lr * lr), nn = sqrt(1 + nx * nx + ny * ny);
    const double hx = vr * cos(va) + lr * cos(la), hy = vr * sin(va) + lr * sin(la), hz = vz + lz;
    const double nl = MAX(0, (nx * lr * cos(la) + ny * lr * sin(la) + lz) / nn);
    const double nh = (nx * hx + ny * hy + hz) / (nn * sqrt(hx * hx + hy * hy + hz * hz));
    const double albedo = 0.3 + 0.2 * sin(x + colour) * sin(y);
    return (float)(albedo * nl + 0.5 * pow(MAX(0, nh), 40) * (nl > 0));
}

/* Sizes only. */
static struct btf_matrix *empty(void) {
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    *btf = (struct btf_matrix){.name = g_strdup("weave"),
                               .layout.width = texels,
                               .layout.height = texels,
                               .layout.texel_mm = 1,
                               .layout.views.n = views,
                               .layout.lights.n = lights,
                               .layout.views.theta_deg = g_new0(float, views),
                               .layout.views.phi_deg = g_new0(float, views),
                               .layout.lights.theta_deg = g_new0(float, lights),
                               .layout.lights.phi_deg = g_new0(float, lights)};
    return btf;
}

static struct btf_matrix *synthetic(void) {
    struct btf_matrix *btf = empty();
    gsize i = 0;
    btf->values = g_new(float, (gsize)texels *(gsize)texels *(gsize)views *(gsize)lights * 3);
    for (int texel = 0; texel < texels * texels; texel++)
        for (int view = 0; view < views; view++)
            for (int light = 0; light < lights; light++)
                for (int colour = 0; colour < 3; colour++)
                    btf->values[i++] = shade(texel, view, light, colour);
    return btf;
}

/* Flops that cannot be avoided: the projection, and the polish with its weights and check. */
static double needed_gflop(const struct btf_matrix *btf, const struct lpca *lpca) {
    const double values =
        (double)btf_layout_texels(&btf->layout) * btf_layout_values(&btf->layout) * 1e-9;
    return 2 * values * (REDUCED + 3.0 * lpca->n_components);
}

static gboolean write_rows(const struct btf_matrix *btf) {
    FILE *file = fopen(dump, "wb");
    const gsize n = btf_layout_texels(&btf->layout) * btf_layout_values(&btf->layout);
    const gboolean ok = file && fwrite(btf->values, sizeof(float), n, file) == n;
    return file && fclose(file) == 0 && ok;
}

/* The time of each stage. The text of the progress tells which stage runs. */
#define MAX_STAGES 8
struct stages {
    double last;
    int n;
    char names[MAX_STAGES][16];
    double seconds[MAX_STAGES];
};

/* What was before the first word of a stage belongs to the one before. */
static void note(const struct work_progress *progress, gpointer data) {
    struct stages *stages = data;
    stages->seconds[stages->n - 1] += bench_now_s() - stages->last;
    stages->last = bench_now_s();
    if (g_str_equal(stages->names[stages->n - 1], progress->stage) || stages->n == MAX_STAGES)
        return;
    g_strlcpy(stages->names[stages->n++], progress->stage, sizeof stages->names[0]);
}

static void measure(const struct btf_matrix *btf, GError **error) {
    struct stages stages = {.n = 1, .names = {"sample"}};
    const struct lpca_options options = {.n_clusters = clusters,
                                         .n_components = components,
                                         .work.progress = note,
                                         .work.data = &stages};
    const int threads = (int)g_get_num_processors();
    const double gflops = peak(threads);
    const double start = stages.last = bench_now_s(), start_cpu = bench_cpu_s();
    struct lpca *lpca = lpca_compute(btf, &options, error);
    const double time = bench_now_s() - start, cpu = bench_cpu_s() - start_cpu;
    if (!lpca)
        return;
    stages.seconds[stages.n - 1] += bench_now_s() - stages.last;
    const double share = needed_gflop(btf, lpca) / time / gflops;
    bench_begin(NULL);
    bench_put("%zu{rows} %zu{columns} %d{clusters} %d{components} %.3f{seconds} %.3f{processor_s} "
              "%.5f{error} %.1f{sgemm_gflops} %.3f{share}",
              btf_layout_texels(&btf->layout), btf_layout_values(&btf->layout), lpca->n_clusters,
              lpca->n_components, time, cpu, lpca->error, gflops, share);
    for (int i = 0; i < stages.n; i++)
        bench_put_double(stages.names[i], "_s", "%.3f", stages.seconds[i]);
    bench_end();
    lpca_free(lpca);
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    if (fields)
        return bench_fields(argv + 1, fits);
#ifdef COMPRESS_MPI
    if (ranks)
        return bench_ranks(ranks, clusters, components);
#endif
    if (rate)
        return bench_rate(argv + 1, every);
    if (bits)
        return bench_bits(argv + 1, every);
    if (mdf)
        return bench_mdf_compression(argv + 1);
    if (resample)
        return bench_resample(argv + 1, clusters, components);
    if (disk || eigenmaps > 0) {
        struct btf_matrix *like = empty();
        const int ret = disk ? bench_disk(like, shade, clusters, components)
                             : bench_eigenmaps(like, shade, eigenmaps);
        btf_matrix_free(like);
        return ret;
    }
    struct btf_matrix *btf = session ? btf_matrix_read(session, NULL, &error) : synthetic();
    bench_check(error);
    if (dump && !write_rows(btf))
        bench_fail(1, "%s: cannot be written", dump);
    measure(btf, &error);
    bench_check(error);
    btf_matrix_free(btf);
    return 0;
}
