#include "compression_parts.h"

#include "bench.h"
#include "codecs/lpca/lpca_pack.h"
#include "codecs/lpca/lpca_private.h"

#include <cblas.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define ITERATIONS  10
#define POWER_STEPS 3
#define SEED        11
#define PACKED      448  /* components, of which those stay that a step leaves */
#define EQUAL       1e-3 /* errors that differ by less, relative, are the same */

/*
 * Local PCA as published (Schneider 2004 §3, after Kambhatla & Leen): clusters begin at drawn
 * texels, each texel goes to the cluster that reconstructs it best, mean and principal axes are
 * found anew, in all dimensions, until nothing changes or often enough. Weights are floats,
 * eigen-BRDFs halves.
 */
struct published {
    const struct btf_matrix *btf;
    int n, d, k, c;
    int *labels;
    float *means, *axes; /* k × d, k × c × d */
};

static const float *texel(const struct published *p, int i) {
    return p->btf->values + (gsize)i * (gsize)p->d;
}

/* Axes by subspace iteration on the rows of a cluster. */
static void find_axes(struct published *p, int k, const int *members, int n, GRand *random) {
    const gsize d = (gsize)p->d;
    float *mean = p->means + (gsize)k * d, *axes = p->axes + (gsize)(k * p->c) * d;
    g_autofree float *rows = g_new(float, (gsize)n *d), *products = g_new(float, n * p->c);
    memset(mean, 0, sizeof(float) * d);
    for (int i = 0; i < n; i++)
        cblas_saxpy(p->d, 1 / (float)n, texel(p, members[i]), 1, mean, 1);
    for (int i = 0; i < n; i++) {
        memcpy(rows + (gsize)i * d, texel(p, members[i]), sizeof(float) * d);
        cblas_saxpy(p->d, -1, mean, 1, rows + (gsize)i * d, 1);
    }
    for (gsize i = 0; i < d * (gsize)p->c; i++)
        if (axes[i] == 0)
            axes[i] = (float)g_rand_double_range(random, -1, 1);
    for (int step = 0; step < POWER_STEPS; step++) {
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, p->c, p->d, 1, rows, p->d, axes,
                    p->d, 0, products, p->c);
        cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, p->c, p->d, n, 1, products, p->c, rows,
                    p->d, 0, axes, p->d);
        lpca_orthonormalise(axes, p->c, p->d, TRUE);
    }
}

static void update(struct published *p, GRand *random) {
    g_autofree int *members = g_new(int, p->n);
    for (int k = 0; k < p->k; k++) {
        int n = 0;
        for (int i = 0; i < p->n; i++)
            if (p->labels[i] == k)
                members[n++] = i;
        if (n > 0)
            find_axes(p, k, members, n, random);
    }
}

/* |x − m|² − Σ ⟨x − m, e⟩², but for |x|², which is the same for all clusters. */
static void add_cluster(const struct published *p, int k, int c, float *best) {
    const gsize d = (gsize)p->d;
    g_autofree float *factors = g_new(float, (gsize)(c + 1) * d), *offsets = g_new0(float, c + 1);
    g_autofree float *products = g_new(float, p->n *(c + 1));
    memcpy(factors, p->means + (gsize)k * d, sizeof(float) * d);
    memcpy(factors + d, p->axes + (gsize)(k * p->c) * d, sizeof(float) * d * (gsize)c);
    for (int j = 0; j <= c; j++)
        offsets[j] = cblas_sdot(p->d, factors, 1, factors + (gsize)j * d, 1);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, p->n, c + 1, p->d, 1, p->btf->values, p->d,
                factors, p->d, 0, products, c + 1);
    for (int i = 0; i < p->n; i++) {
        const float *product = products + (gsize)(i * (c + 1));
        float error = offsets[0] - 2 * product[0];
        for (int j = 1; j <= c; j++)
            error -= (product[j] - offsets[j]) * (product[j] - offsets[j]);
        if (k > 0 && error >= best[i])
            continue;
        best[i] = error;
        p->labels[i] = k;
    }
}

/* Without axes to the nearest mean. Returns how many changed. */
static int assign(const struct published *p, gboolean axes) {
    g_autofree float *best = g_new(float, p->n);
    g_autofree int *before = g_memdup2(p->labels, sizeof(int) * (gsize)p->n);
    int changed = 0;
    for (int k = 0; k < p->k; k++)
        add_cluster(p, k, axes ? p->c : 0, best);
    for (int i = 0; i < p->n; i++)
        changed += before[i] != p->labels[i];
    return changed;
}

static void train(struct published *p) {
    GRand *random = g_rand_new_with_seed(SEED);
    for (int k = 0; k < p->k; k++)
        memcpy(p->means + (gsize)k * (gsize)p->d, texel(p, g_rand_int_range(random, 0, p->n)),
               sizeof(float) * (gsize)p->d);
    assign(p, FALSE);
    for (int i = 0; i < ITERATIONS; i++) {
        update(p, random);
        if (p->k == 1 || assign(p, TRUE) == 0)
            break;
    }
    update(p, random);
    g_rand_free(random);
}

/* As it is stored: the same struct as ours, so that one function tells both errors. */
static struct lpca *store(const struct published *p) {
    struct lpca *lpca = lpca_new(p->btf, p->k, p->c);
    const gsize d = (gsize)p->d;
    memcpy(lpca->clusters, p->labels, sizeof(int) * (gsize)p->n);
    for (int k = 0; k < p->k; k++) {
        memcpy(lpca_brdf(lpca, k, 0), p->means + (gsize)k * d, sizeof(float) * d);
        memcpy(lpca_brdf(lpca, k, 1), p->axes + (gsize)(k * p->c) * d,
               sizeof(float) * d * (gsize)p->c);
    }
    g_autofree float *row = g_new(float, d);
    for (int i = 0; i < p->n; i++) {
        memcpy(row, texel(p, i), sizeof(float) * d);
        cblas_saxpy(p->d, -1, p->means + (gsize)p->labels[i] * d, 1, row, 1);
        cblas_sgemv(CblasRowMajor, CblasNoTrans, p->c, p->d, 1, lpca_brdf(lpca, p->labels[i], 1),
                    p->d, row, 1, 0, lpca->weights + (gsize)(i * p->c), 1);
    }
    g_autofree float *weights = g_memdup2(lpca->weights, sizeof(float) * (gsize)p->n * (gsize)p->c);
    lpca_quantise(lpca, LPCA_HALF);
    memcpy(lpca->weights, weights, sizeof(float) * (gsize)p->n * (gsize)p->c);
    return lpca;
}

static void add_point(GArray *points, char *label, double bytes, double error) {
    const struct bench_point point = {label, bytes, error};
    g_array_append_val(points, point);
}

static void add_published(GArray *points, const struct btf_matrix *noisy,
                          const struct btf_matrix *quiet, int k, int c) {
    struct published p = {noisy, btf_layout_texels(&noisy->layout),
                          (int)btf_layout_values(&noisy->layout), k, c};
    p.labels = g_new0(int, p.n);
    p.means = g_new0(float, (gsize)k *(gsize)p.d);
    p.axes = g_new0(float, (gsize)(k * c) * (gsize)p.d);
    train(&p);
    struct lpca *lpca = store(&p);
    add_point(points, g_strdup_printf("%d × %d", k, c),
              (double)lpca_bytes(lpca) + 2.0 * p.n * c /* floats, not halves */,
              lpca_error(lpca, quiet, 0));
    lpca_free(lpca);
    g_free(p.labels);
    g_free(p.means);
    g_free(p.axes);
}

static void add_stored(GArray *points, const struct lpca *lpca, int c,
                       const struct btf_matrix *quiet) {
    for (int kind = LPCA_HALF; kind < LPCA_QUANTISE_KINDS; kind++) {
        struct lpca *fewer = lpca_truncated(lpca, c);
        lpca_quantise(fewer, (enum lpca_quantise)kind);
        add_point(points,
                  g_strdup_printf("%d × %d %s", fewer->n_clusters, c,
                                  lpca_quantise_name(fewer->quantise)),
                  (double)lpca_bytes(fewer), lpca_error(fewer, quiet, 0));
        lpca_free(fewer);
    }
}

static gboolean add_ours(GArray *points, const struct btf_matrix *noisy,
                         const struct btf_matrix *quiet, int k, int c, GError **error) {
    const struct lpca_options options = {.n_clusters = k, .n_components = c};
    struct lpca *lpca = lpca_compute(noisy, &options, error);
    if (!lpca)
        return FALSE;
    add_stored(points, lpca, c, quiet);
    if (c > 2)
        add_stored(points, lpca, 3 * c / 4, quiet);
    lpca_free(lpca);
    return TRUE;
}

/* On disk: what the whole file takes. */
static gboolean add_packed(GArray *points, const struct btf_matrix *noisy,
                           const struct btf_matrix *quiet, double mean, GError **error) {
    const int values = (int)btf_layout_values(&noisy->layout);
    const struct lpca_options options = {
        1, MIN(PACKED, MIN(values, btf_layout_texels(&noisy->layout))), .to_pack = TRUE};
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "bench_rate_packed.exr", NULL);
    struct lpca *exact = lpca_compute(noisy, &options, error);
    struct lpca_packer *packer = exact ? lpca_packer_new(exact, 0) : NULL;
    gboolean ok = exact != NULL;
    for (double step = 4; ok && step > 0.03; step /= 2) {
        GStatBuf status = {0};
        struct lpca *lpca = lpca_packer_round(packer, step * mean);
        ok = lpca_write(path, lpca, error) && g_stat(path, &status) == 0;
        add_point(points, g_strdup_printf("%d packed", lpca->n_components), (double)status.st_size,
                  lpca_error(lpca, quiet, 0));
        lpca_free(lpca);
    }
    g_unlink(path);
    lpca_packer_free(packer);
    lpca_free(exact);
    return ok;
}

static int by_bytes(gconstpointer a, gconstpointer b) {
    const struct bench_point *p = a, *q = b;
    return (p->bytes > q->bytes) - (p->bytes < q->bytes);
}

void bench_keep_best(GArray *points) {
    guint kept = 0;
    g_array_sort(points, by_bytes);
    struct bench_point *list = &g_array_index(points, struct bench_point, 0);
    for (guint i = 0; i < points->len; i++)
        if (kept == 0 || list[i].error < list[kept - 1].error)
            list[kept++] = list[i];
        else
            g_free(list[i].label);
    g_array_set_size(points, kept);
}

static void clear(GArray *points) {
    for (guint i = 0; i < points->len; i++)
        g_free(g_array_index(points, struct bench_point, i).label);
    g_array_unref(points);
}

/* Bytes at which a curve reaches an error, straight in logarithms between its points; ∞ where it
 * does not. */
static double bytes_at(const GArray *points, double error) {
    const struct bench_point *list = &g_array_index(points, struct bench_point, 0);
    for (guint i = 0; i < points->len; i++) {
        if (list[i].error > error * (1 + EQUAL))
            continue;
        if (i == 0)
            return list[0].bytes;
        const double t = log(list[i - 1].error / error) / log(list[i - 1].error / list[i].error);
        return list[i - 1].bytes * pow(list[i].bytes / list[i - 1].bytes, t);
    }
    return INFINITY;
}

/* Keeps every n-th view only, which takes that many times less time. */
static void thin_views(struct btf_matrix *btf, int n) {
    const int kept = (btf->layout.views.n + n - 1) / n;
    const gsize columns = btf->layout.lights.n * 3, texels = btf_layout_texels(&btf->layout);
    for (gsize x = 0; x < texels; x++)
        for (int view = 0; view < kept; view++)
            memmove(btf->values + (x * (gsize)kept + (gsize)view) * columns,
                    btf->values + (x * btf->layout.views.n + (gsize)(view * n)) * columns,
                    sizeof(float) * columns);
    for (int view = 0; view < kept; view++) {
        btf->layout.views.theta_deg[view] = btf->layout.views.theta_deg[view * n];
        btf->layout.views.phi_deg[view] = btf->layout.views.phi_deg[view * n];
    }
    btf->layout.views.n = kept;
}

/* Relative to the quiet one, whose mean size it also tells. */
static double noise(const struct btf_matrix *noisy, const struct btf_matrix *quiet,
                    double *ret_mean) {
    const gint64 n = btf_matrix_bytes(&noisy->layout) / (gint64)sizeof(float);
    double rest = 0, all = 0;
    for (gint64 i = 0; i < n; i++) {
        const double away = (double)noisy->values[i] - quiet->values[i];
        rest += away * away;
        all += (double)quiet->values[i] * quiet->values[i];
    }
    *ret_mean = sqrt(all / (double)n);
    return sqrt(rest / all);
}

static void print_curve(const char *name, const GArray *points, double raw) {
    bench_begin_list(name);
    for (guint i = 0; i < points->len; i++) {
        const struct bench_point *point = &g_array_index(points, struct bench_point, i);
        bench_row(NULL, "%-22s{label} %.1f{ratio} %.5f{error}", point->label, raw / point->bytes,
                  point->error);
    }
    bench_end();
}

/* How many times smaller ours is at the error of each published point; and about 1:100. */
static void print_gain(const char *name, const GArray *published, const GArray *ours, double raw) {
    double least = INFINITY, at_100 = NAN, nearest = INFINITY;
    for (guint i = 0; i < published->len; i++) {
        const struct bench_point *p = &g_array_index(published, struct bench_point, i);
        const double gain = p->bytes / bytes_at(ours, p->error);
        const double away = fabs(log(raw / p->bytes / 100));
        least = MIN(least, gain);
        if (away < nearest) {
            nearest = away;
            at_100 = gain;
        }
    }
    const double two = raw / bytes_at(ours, 0.02), theirs = raw / bytes_at(published, 0.02);
    g_autofree char *key = g_strconcat(name, "_gain", NULL);
    bench_row(
        key, "%.3f{least} %.3f{at_100} %.1f{ratio_at_2_percent} %.1f{published_ratio_at_2_percent}",
        least, at_100, two, theirs);
}

static void measure(const struct btf_matrix *noisy, const struct btf_matrix *quiet,
                    GError **error) {
    static const int clusters[] = {1, 2, 4, 16};
    GArray *published = g_array_new(FALSE, FALSE, sizeof(struct bench_point));
    GArray *ours = g_array_new(FALSE, FALSE, sizeof(struct bench_point));
    GArray *packed = g_array_new(FALSE, FALSE, sizeof(struct bench_point));
    double mean;
    const double grain = noise(noisy, quiet, &mean);
    const double raw = (double)btf_matrix_bytes(&noisy->layout) / 2;
    gboolean ok = TRUE;
    for (guint i = 0; ok && i < G_N_ELEMENTS(clusters); i++)
        for (int c = 1; ok && c <= LPCA_MAX_COMPONENTS && c * clusters[i] <= 128; c *= 2) {
            add_published(published, noisy, quiet, clusters[i], c);
            ok = add_ours(ours, noisy, quiet, clusters[i], c, error);
        }
    ok = ok && add_packed(packed, noisy, quiet, mean, error);
    bench_keep_best(published);
    bench_keep_best(ours);
    bench_keep_best(packed);
    bench_begin(NULL);
    bench_put("%s{material} %.5f{noise}", noisy->name, grain);
    print_curve("published", published, raw);
    print_curve("drawn", ours, raw);
    print_curve("packed", packed, raw);
    print_gain("drawn", published, ours, raw);
    print_gain("packed", published, packed, raw);
    bench_end();
    clear(published);
    clear(ours);
    clear(packed);
}

int bench_pairs(char *const *sessions, int every, const char *option, const char *list,
                BenchPair measure_pair) {
    g_autoptr(GError) error = NULL;
    const guint n = g_strv_length((char **)sessions);
    if (n == 0 || n % 2)
        bench_fail(2, "%s takes a session and the same without noise, pair by pair", option);
    bench_begin(NULL);
    bench_begin_list(list);
    for (guint i = 0; i < n; i += 2) {
        struct btf_matrix *noisy = btf_matrix_read(sessions[i], NULL, &error);
        struct btf_matrix *quiet = noisy ? btf_matrix_read(sessions[i + 1], NULL, &error) : NULL;
        bench_check(error);
        thin_views(noisy, every);
        thin_views(quiet, every);
        measure_pair(noisy, quiet, &error);
        bench_check(error);
        btf_matrix_free(noisy);
        btf_matrix_free(quiet);
    }
    bench_end();
    bench_end();
    return 0;
}

int bench_rate(char *const *sessions, int every) {
    return bench_pairs(sessions, every, "--rate", "materials", measure);
}
