#include "lpca.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "exr_half.h"
#include "lpca_private.h"

#define SEED      7
#define SAMPLES   768 /* texels whose span the clustering works in */
#define REDUCED   128 /* dimensions of that span */
#define BLOCK     64  /* rows multiplied at a time */
#define TILE      128 /* of the Gram matrix */
#define COLOURS   3
#define LARGEST_Q 127

void btf_matrix_free(struct btf_matrix *btf) {
    if (!btf)
        return;
    g_free(btf->name);
    g_free(btf->directory);
    g_free(btf->view_theta_deg);
    g_free(btf->view_phi_deg);
    g_free(btf->light_theta_deg);
    g_free(btf->light_phi_deg);
    g_free(btf->values);
    g_free(btf);
}

void lpca_free(struct lpca *lpca) {
    if (!lpca)
        return;
    g_free(lpca->name);
    g_free(lpca->view_theta_deg);
    g_free(lpca->view_phi_deg);
    g_free(lpca->light_theta_deg);
    g_free(lpca->light_phi_deg);
    g_free(lpca->clusters);
    g_free(lpca->weights);
    g_free(lpca->brdfs);
    g_free(lpca->scales);
    g_free(lpca);
}

struct parallel {
    LpcaBlock func;
    gpointer data;
};

/* OpenBLAS on OpenMP keeps a number of threads for each thread that calls it: without this, each of
 * ours would start a team of its own. */
static void use_one_thread(void) {
    static GMutex mutex;
    g_mutex_lock(&mutex);
    openblas_set_num_threads(1);
    g_mutex_unlock(&mutex);
}

static void run_block(gpointer number, gpointer data) {
    const struct parallel *parallel = data;
    use_one_thread();
    parallel->func(GPOINTER_TO_INT(number) - 1, parallel->data);
}

void lpca_parallel(int n_threads, int n, LpcaBlock func, gpointer data) {
    struct parallel parallel = {func, data};
    const int threads = n_threads > 0 ? n_threads : (int)g_get_num_processors();
    const int before = openblas_get_num_threads();
    use_one_thread();
    GThreadPool *pool = g_thread_pool_new(run_block, &parallel, threads, FALSE, NULL);
    for (int i = 0; i < n; i++)
        g_thread_pool_push(pool, GINT_TO_POINTER(i + 1), NULL);
    g_thread_pool_free(pool, FALSE, TRUE);
    openblas_set_num_threads(before);
}

void lpca_orthonormalise(float *rows, int n, int length, gboolean drop) {
    g_autofree float *tau = g_new0(float, n), *diagonal = g_new0(float, n);
    float largest = 0;
    LAPACKE_sgeqrf(LAPACK_COL_MAJOR, length, n, rows, length, tau);
    for (int i = 0; i < n; i++) {
        diagonal[i] = fabsf(rows[(gsize)i * (gsize)length + (gsize)i]);
        largest = MAX(largest, diagonal[i]);
    }
    LAPACKE_sorgqr(LAPACK_COL_MAJOR, length, n, n, rows, length, tau);
    for (int i = 0; drop && i < n; i++)
        if (!(diagonal[i] > 1e-6F * largest))
            memset(rows + (gsize)i * (gsize)length, 0, sizeof(float) * (gsize)length);
}

/* Everything lpca_compute() holds. */
struct run {
    const struct btf_matrix *btf;
    const struct lpca_options *options;
    int n, d; /* texels, values of each */
    float *mean;
    int samples;
    float *sample; /* samples × d, less the mean */
    float *gram;   /* samples × samples, lower half */
    int r;
    float *axes;    /* r × d */
    float *offsets; /* r: products of axes and mean */
    float *rows;    /* n × r */
};

static const float *texel_row(const struct run *run, int texel) {
    return run->btf->values + (gsize)texel * (gsize)run->d;
}

static int dimensions(int n_views, int n_lights) {
    return n_views * n_lights * COLOURS;
}

static gboolean tell(const struct run *run, const char *stage, int done, int total,
                     GError **error) {
    const struct pipeline_progress progress = {stage, done, total, -1};
    if (run->options->progress)
        run->options->progress(&progress, run->options->data);
    return !g_cancellable_set_error_if_cancelled(run->options->cancellable, error);
}

static float *mean_of(const struct run *run, const int *texels, int n) {
    g_autofree double *sums = g_new0(double, run->d);
    float *mean = g_new(float, run->d);
    for (int i = 0; i < n; i++) {
        const float *row = texel_row(run, texels ? texels[i] : i);
        for (int j = 0; j < run->d; j++)
            sums[j] += row[j];
    }
    for (int j = 0; j < run->d; j++)
        mean[j] = (float)(sums[j] / n);
    return mean;
}

/* Drawn, for a regular choice would follow the weave. */
static void draw_sample(struct run *run) {
    g_autofree int *texels = g_new(int, run->n);
    GRand *random = g_rand_new_with_seed(SEED);
    run->samples = MIN(run->n, SAMPLES);
    run->sample = g_new(float, (gsize)run->samples *(gsize)run->d);
    for (int i = 0; i < run->n; i++)
        texels[i] = i;
    for (int i = 0; i < run->samples; i++) {
        const int other = g_rand_int_range(random, i, run->n), texel = texels[other];
        texels[other] = texels[i];
        float *to = run->sample + (gsize)i * (gsize)run->d;
        const float *from = texel_row(run, texel);
        for (int j = 0; j < run->d; j++)
            to[j] = from[j] - run->mean[j];
    }
    g_rand_free(random);
}

static void gram_tile(int block, gpointer data) {
    const struct run *run = data;
    const int tiles = (run->samples + TILE - 1) / TILE;
    const int i = block / tiles * TILE, j = block % tiles * TILE;
    if (j > i)
        return;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, MIN(TILE, run->samples - i),
                MIN(TILE, run->samples - j), run->d, 1, run->sample + (gsize)i * (gsize)run->d,
                run->d, run->sample + (gsize)j * (gsize)run->d, run->d, 0,
                run->gram + (gsize)i * (gsize)run->samples + (gsize)j, run->samples);
}

/* The principal axes of the sample: those of its Gram matrix, carried over. */
static gboolean find_axes(struct run *run, GError **error) {
    const int m = run->samples, tiles = (m + TILE - 1) / TILE, wanted = MIN(run->r, m);
    run->gram = g_new0(float, (gsize)m *(gsize)m);
    lpca_parallel(run->options->n_threads, tiles * tiles, gram_tile, run);
    g_autofree float *values = g_new0(float, m);
    g_autofree float *vectors = g_new0(float, (gsize)m *(gsize)wanted);
    g_autofree int *support = g_new0(int, 2 * m);
    int found = 0;
    /* The lower half by rows is the upper one by columns. */
    const int info = LAPACKE_ssyevr(LAPACK_COL_MAJOR, 'V', 'I', 'U', m, run->gram, m, 0, 0,
                                    m - wanted + 1, m, 0, &found, values, vectors, m, support);
    if (info != 0) {
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "the principal axes of %d texels were not found (ssyevr: %d)", m, info);
        return FALSE;
    }
    int useful = 0;
    while (useful < found && values[found - 1 - useful] > 1e-7F * values[found - 1])
        useful++;
    run->axes = g_new0(float, (gsize)run->r *(gsize)run->d);
    for (int i = 0; i < useful; i++)
        cblas_sgemv(CblasRowMajor, CblasTrans, m, run->d, 1 / sqrtf(values[found - 1 - i]),
                    run->sample, run->d, vectors + (gsize)(found - 1 - i) * (gsize)m, 1, 0,
                    run->axes + (gsize)i * (gsize)run->d, 1);
    if (useful > 0)
        lpca_orthonormalise(run->axes, useful, run->d, TRUE);
    return TRUE;
}

static void reduce_block(int block, gpointer data) {
    const struct run *run = data;
    const int from = block * BLOCK, n = MIN(BLOCK, run->n - from);
    float *rows = run->rows + (gsize)from * (gsize)run->r;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, run->r, run->d, 1, texel_row(run, from),
                run->d, run->axes, run->d, 0, rows, run->r);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < run->r; j++)
            rows[i * run->r + j] -= run->offsets[j];
}

static gboolean reduce(struct run *run, GError **error) {
    if (!tell(run, "reduce", 0, 3, error))
        return FALSE;
    run->mean = mean_of(run, NULL, run->n);
    draw_sample(run);
    if (!tell(run, "reduce", 1, 3, error) || !find_axes(run, error) ||
        !tell(run, "reduce", 2, 3, error))
        return FALSE;
    run->offsets = g_new(float, run->r);
    for (int i = 0; i < run->r; i++)
        run->offsets[i] = cblas_sdot(run->d, run->axes + (gsize)i * (gsize)run->d, 1, run->mean, 1);
    run->rows = g_new(float, (gsize)run->n *(gsize)run->r);
    lpca_parallel(run->options->n_threads, (run->n + BLOCK - 1) / BLOCK, reduce_block, run);
    return tell(run, "reduce", 3, 3, error);
}

/* From a clustering in few dimensions to one in all. */
struct polish {
    const struct run *run;
    const struct lpca_reduced *reduced;
    struct lpca *lpca;
};

static float *brdf_of(const struct lpca *lpca, int cluster, int component) {
    return lpca->brdfs + (gsize)(cluster * (lpca->n_components + 1) + component) *
                             (gsize)dimensions(lpca->n_views, lpca->n_lights);
}

static void gather(const struct polish *polish, const float *mean, const int *texels, int n,
                   float *to) {
    const int d = polish->run->d;
    for (int i = 0; i < n; i++) {
        const float *row = texel_row(polish->run, texels[i]);
        for (int j = 0; j < d; j++)
            to[(gsize)i * (gsize)d + (gsize)j] = row[j] - mean[j];
    }
}

/* n × c products of the cluster's rows with its axes in few dimensions. */
static float *reduced_weights(const struct polish *polish, int cluster, const GArray *texels) {
    const struct lpca_reduced *reduced = polish->reduced;
    const gsize r = (gsize)reduced->r;
    const int c = reduced->c;
    float *weights = g_new(float, (gsize)texels->len *(gsize)c);
    g_autofree float *row = g_new(float, r);
    for (guint i = 0; i < texels->len; i++) {
        const float *from = reduced->rows + (gsize)g_array_index(texels, int, i) * r;
        for (gsize j = 0; j < r; j++)
            row[j] = from[j] - reduced->means[(gsize)cluster * r + j];
        cblas_sgemv(CblasRowMajor, CblasNoTrans, c, reduced->r, 1,
                    reduced->bases + (gsize)(cluster * c) * r, reduced->r, row, 1, 0,
                    weights + (gsize)i * (gsize)c, 1);
    }
    return weights;
}

/* Turned so that the components are uncorrelated and descend. */
static void turn(float *axes, float *weights, int n, int c, int d) {
    g_autofree float *covariance = g_new0(float, c *c), *values = g_new0(float, c);
    g_autofree float *vectors = g_new0(float, c *c);
    g_autofree float *old = g_memdup2(axes, sizeof(float) * (gsize)c * (gsize)d);
    g_autofree float *before = g_memdup2(weights, sizeof(float) * (gsize)c * (gsize)n);
    cblas_ssyrk(CblasColMajor, CblasUpper, CblasNoTrans, c, n, 1, weights, c, 0, covariance, c);
    if (LAPACKE_ssyev(LAPACK_COL_MAJOR, 'V', 'U', c, covariance, c, values) != 0)
        return;
    for (int i = 0; i < c; i++)
        memcpy(vectors + (gsize)(i * c), covariance + (gsize)((c - 1 - i) * c),
               sizeof(float) * (gsize)c);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, c, d, c, 1, vectors, c, old, d, 0, axes,
                d);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, c, c, 1, before, c, vectors, c, 0,
                weights, c);
}

/* Weights that are all 0 belong to axes without a meaning. */
static void drop_unused(float *axes, float *weights, int n, int c, int d) {
    double largest = 0;
    g_autofree double *sizes = g_new0(double, c);
    for (int i = 0; i < n * c; i++)
        sizes[i % c] += (double)weights[i] * weights[i];
    for (int i = 0; i < c; i++)
        largest = MAX(largest, sizes[i]);
    for (int i = 0; i < c; i++) {
        if (sizes[i] > 1e-12 * largest)
            continue;
        memset(axes + (gsize)i * (gsize)d, 0, sizeof(float) * (gsize)d);
        for (int j = 0; j < n; j++)
            weights[j * c + i] = 0;
    }
}

/* E_k = orth(X_kᵀ W_k), then the weights of all its texels. */
static void polish_cluster(int cluster, gpointer data) {
    const struct polish *polish = data;
    const GArray *texels = g_ptr_array_index(polish->reduced->members, cluster);
    const int d = polish->run->d, c = polish->reduced->c, n = (int)texels->len;
    const int *list = (const int *)(gconstpointer)texels->data;
    float *axes = brdf_of(polish->lpca, cluster, 1);
    g_autofree float *mean = mean_of(polish->run, list, n);
    g_autofree float *weights = reduced_weights(polish, cluster, texels);
    g_autofree float *rows = g_new(float, (gsize)MIN(n, BLOCK) * (gsize)d);
    memcpy(brdf_of(polish->lpca, cluster, 0), mean, sizeof(float) * (gsize)d);
    for (int i = 0; i < n; i += BLOCK) {
        const int part = MIN(BLOCK, n - i);
        gather(polish, mean, list + i, part, rows);
        cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, c, d, part, 1,
                    weights + (gsize)i * (gsize)c, c, rows, d, i > 0, axes, d);
    }
    lpca_orthonormalise(axes, c, d, TRUE);
    for (int i = 0; i < n; i += BLOCK) {
        const int part = MIN(BLOCK, n - i);
        gather(polish, mean, list + i, part, rows);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, part, c, d, 1, rows, d, axes, d, 0,
                    weights + (gsize)i * (gsize)c, c);
    }
    turn(axes, weights, n, c, d);
    drop_unused(axes, weights, n, c, d);
    for (int i = 0; i < n; i++)
        memcpy(polish->lpca->weights + (gsize)list[i] * (gsize)c, weights + (gsize)i * (gsize)c,
               sizeof(float) * (gsize)c);
}

static float *copy(const float *values, gsize n) {
    return g_memdup2(values, sizeof(float) * n);
}

static struct lpca *lpca_new(const struct btf_matrix *btf, int n_clusters, int n_components) {
    const gsize tables = (gsize)n_clusters * (gsize)(n_components + 1);
    const gsize texels = (gsize)btf->width * (gsize)btf->height;
    struct lpca *lpca = g_new0(struct lpca, 1);
    *lpca = (struct lpca){
        .name = g_strdup(btf->name),
        .width = btf->width,
        .height = btf->height,
        .texel_mm = btf->texel_mm,
        .reference_mm = btf->reference_mm,
        .n_views = btf->n_views,
        .n_lights = btf->n_lights,
        .n_clusters = n_clusters,
        .n_components = n_components,
        .view_theta_deg = copy(btf->view_theta_deg, (gsize)btf->n_views),
        .view_phi_deg = copy(btf->view_phi_deg, (gsize)btf->n_views),
        .light_theta_deg = copy(btf->light_theta_deg, (gsize)btf->n_lights),
        .light_phi_deg = copy(btf->light_phi_deg, (gsize)btf->n_lights),
        .clusters = g_new0(int, texels),
        .weights = g_new0(float, texels *(gsize)n_components),
        .brdfs = g_new0(float, tables *(gsize)dimensions(btf->n_views, btf->n_lights)),
        .scales = g_new(float, tables),
    };
    for (gsize i = 0; i < tables; i++)
        lpca->scales[i] = 1;
    return lpca;
}

static struct lpca *make(struct run *run, int n_components, GError **error) {
    const struct lpca_options *options = run->options;
    struct lpca_reduced reduced = {.n = run->n,
                                   .r = run->r,
                                   .rows = run->rows,
                                   .n_threads = options->n_threads,
                                   .progress = options->progress,
                                   .data = options->data,
                                   .cancellable = options->cancellable,
                                   .k = options->n_clusters,
                                   .c = n_components};
    struct lpca *lpca = NULL;
    if (lpca_cluster(&reduced, error) && tell(run, "polish", 0, 2, error)) {
        lpca = lpca_new(run->btf, reduced.k, n_components);
        struct polish polish = {run, &reduced, lpca};
        memcpy(lpca->clusters, reduced.labels, sizeof(int) * (gsize)run->n);
        lpca_parallel(options->n_threads, reduced.k, polish_cluster, &polish);
        if (tell(run, "polish", 1, 2, error))
            lpca_error(lpca, run->btf, options->n_threads);
        if (!tell(run, "polish", 2, 2, error))
            g_clear_pointer(&lpca, lpca_free);
    }
    lpca_reduced_clear(&reduced);
    return lpca;
}

/* The fewest components of this clustering that reach the target. */
static struct lpca *fewest(struct lpca *lpca, const struct run *run) {
    while (lpca->n_components > 1) {
        struct lpca *fewer = lpca_truncated(lpca, lpca->n_components - 1);
        if (lpca_error(fewer, run->btf, run->options->n_threads) > run->options->target) {
            lpca_free(fewer);
            break;
        }
        lpca_free(lpca);
        lpca = fewer;
    }
    return lpca;
}

static struct lpca *search(struct run *run, GError **error) {
    const struct lpca_options *options = run->options;
    for (int c = 1;; c = MIN(2 * c, options->n_components)) {
        struct lpca *lpca = make(run, c, error);
        if (!lpca)
            return NULL;
        if (lpca->error <= options->target)
            return fewest(lpca, run);
        if (c == options->n_components) {
            g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                        "an error of %.3g %% is not reached with %d clusters of %d components "
                        "(%.3g %%); allow more of them",
                        100 * options->target, lpca->n_clusters, c, 100 * lpca->error);
            lpca_free(lpca);
            return NULL;
        }
        lpca_free(lpca);
    }
}

static gboolean check(const struct btf_matrix *btf, const struct lpca_options *options,
                      GError **error) {
    const gint64 texels = (gint64)btf->width * btf->height;
    const gint64 values = (gint64)btf->n_views * btf->n_lights * COLOURS;
    const char *what = NULL;
    if (texels < 1 || values < 1 || texels > G_MAXINT / 2 || values > G_MAXINT / 2)
        what = "there are no texels, views or lights, or far too many";
    else if (options->n_clusters < 1 || options->n_clusters > MIN(texels, LPCA_MAX_CLUSTERS))
        what = "there can be 1 to 1024 clusters, and no more than texels";
    else if (options->n_components < 1 || options->n_components > MIN(values, LPCA_MAX_COMPONENTS))
        what = "there can be 1 to 32 components, and no more than values of a texel";
    else if (!isfinite(options->target) || options->target < 0)
        what = "the error to reach must be a number above 0";
    if (what)
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "%d clusters of %d components for %d × %d texels, %d views and %d lights: %s",
                    options->n_clusters, options->n_components, btf->width, btf->height,
                    btf->n_views, btf->n_lights, what);
    for (gint64 i = 0; !what && i < texels * values; i++)
        if (!isfinite(btf->values[i])) {
            const int view = (int)(i % values / COLOURS / btf->n_lights);
            g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                        "view %d, texel (%d, %d) is not a number; make that view's BTF again", view,
                        (int)(i / values % btf->width), (int)(i / values / btf->width));
            return FALSE;
        }
    return what == NULL;
}

struct lpca *lpca_compute(const struct btf_matrix *btf, const struct lpca_options *options,
                          GError **error) {
    struct lpca *lpca = NULL;
    if (!check(btf, options, error))
        return NULL;
    struct run run = {.btf = btf, .options = options, .n = btf->width * btf->height};
    run.d = dimensions(btf->n_views, btf->n_lights);
    run.r = MIN(run.d, REDUCED);
    /* The order of sums, and with it the last bits, would depend on the number of threads. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    if (reduce(&run, error))
        lpca = options->target > 0 ? search(&run, error) : make(&run, options->n_components, error);
    openblas_set_num_threads(threads);
    g_free(run.mean);
    g_free(run.sample);
    g_free(run.gram);
    g_free(run.axes);
    g_free(run.offsets);
    g_free(run.rows);
    return lpca;
}

struct lpca *lpca_truncated(const struct lpca *lpca, int n_components) {
    const struct btf_matrix like = {
        lpca->name,         lpca->width,           lpca->height,       lpca->texel_mm,
        lpca->reference_mm, lpca->n_views,         lpca->n_lights,     lpca->view_theta_deg,
        lpca->view_phi_deg, lpca->light_theta_deg, lpca->light_phi_deg};
    const int c = lpca->n_components, texels = lpca->width * lpca->height;
    const gsize d = (gsize)dimensions(lpca->n_views, lpca->n_lights);
    g_return_val_if_fail(n_components >= 1 && n_components <= c, NULL);
    struct lpca *fewer = lpca_new(&like, lpca->n_clusters, n_components);
    memcpy(fewer->clusters, lpca->clusters, sizeof(int) * (gsize)texels);
    for (int i = 0; i < texels; i++)
        memcpy(fewer->weights + (gsize)i * (gsize)n_components, lpca->weights + (gsize)i * (gsize)c,
               sizeof(float) * (gsize)n_components);
    for (int k = 0; k < lpca->n_clusters; k++) {
        memcpy(brdf_of(fewer, k, 0), brdf_of(lpca, k, 0),
               sizeof(float) * d * (gsize)(n_components + 1));
        memcpy(fewer->scales + (gsize)(k * (n_components + 1)), lpca->scales + (gsize)(k * (c + 1)),
               sizeof(float) * (gsize)(n_components + 1));
    }
    fewer->quantise = lpca->quantise;
    fewer->n_grid = lpca->n_grid;
    return fewer;
}

static void add_components(const struct lpca *lpca, int texel, int from, int n, float *ret) {
    const int k = lpca->clusters[texel], c = lpca->n_components;
    memcpy(ret, brdf_of(lpca, k, 0) + from, sizeof(float) * (gsize)n);
    for (int i = 0; i < c; i++) {
        const float weight = lpca->weights[(gsize)texel * (gsize)c + (gsize)i];
        const float *brdf = brdf_of(lpca, k, i + 1) + from;
        for (int j = 0; j < n; j++)
            ret[j] += weight * brdf[j];
    }
}

void lpca_reconstruct(const struct lpca *lpca, int texel, float *ret) {
    add_components(lpca, texel, 0, dimensions(lpca->n_views, lpca->n_lights), ret);
}

struct comparison {
    const struct lpca *lpca;
    const struct btf_matrix *btf;
    double *rest, *all; /* one a block */
};

static void compare_block(int block, gpointer data) {
    const struct comparison *to = data;
    const int d = dimensions(to->lpca->n_views, to->lpca->n_lights);
    const int end = MIN((block + 1) * BLOCK, to->lpca->width * to->lpca->height);
    float part[1024]; /* stays in the cache while all components are added */
    for (int texel = block * BLOCK; texel < end; texel++)
        for (int from = 0; from < d; from += (int)G_N_ELEMENTS(part)) {
            const int n = MIN((int)G_N_ELEMENTS(part), d - from);
            const float *truth = to->btf->values + (gsize)texel * (gsize)d + (gsize)from;
            add_components(to->lpca, texel, from, n, part);
            for (int j = 0; j < n; j++)
                part[j] -= truth[j];
            to->rest[block] += cblas_sdot(n, part, 1, part, 1);
            to->all[block] += cblas_sdot(n, truth, 1, truth, 1);
        }
}

double lpca_error(struct lpca *lpca, const struct btf_matrix *btf, int n_threads) {
    const int blocks = (lpca->width * lpca->height + BLOCK - 1) / BLOCK;
    g_autofree double *sums = g_new0(double, 2 * blocks);
    struct comparison to = {lpca, btf, sums, sums + blocks};
    double rest = 0, all = 0;
    lpca_parallel(n_threads, blocks, compare_block, &to);
    for (int i = 0; i < blocks; i++) {
        rest += to.rest[i];
        all += to.all[i];
    }
    lpca->error = all > 0 ? sqrt(rest / all) : 0;
    return lpca->error;
}

static void to_halves(float *values, gsize n) {
    g_autofree guint16 *halves = g_new(guint16, n);
    exr_half_from_floats(halves, values, n);
    exr_half_to_floats(values, halves, n);
}

static void to_steps(float *values, gsize n, float *ret_scale) {
    float largest = 0;
    for (gsize i = 0; i < n; i++)
        largest = MAX(largest, fabsf(values[i]));
    *ret_scale = largest > 0 ? largest / LARGEST_Q : 1;
    for (gsize i = 0; i < n; i++)
        values[i] = roundf(values[i] / *ret_scale) * *ret_scale;
}

void lpca_quantise(struct lpca *lpca, enum lpca_quantise quantise) {
    const gsize d = (gsize)dimensions(lpca->n_views, lpca->n_lights);
    const int tables = lpca->n_components + 1;
    g_return_if_fail(lpca->quantise == LPCA_FLOAT);
    lpca->quantise = quantise;
    lpca->error = 0;
    if (quantise == LPCA_FLOAT)
        return;
    to_halves(lpca->weights, (gsize)lpca->width * (gsize)lpca->height * (gsize)lpca->n_components);
    for (int i = 0; i < lpca->n_clusters * tables; i++)
        if (quantise == LPCA_8BIT && i % tables > 0)
            to_steps(lpca->brdfs + (gsize)i * d, d, &lpca->scales[i]);
        else
            to_halves(lpca->brdfs + (gsize)i * d, d);
}

gint64 lpca_bytes(const struct lpca *lpca) {
    const gint64 texels = (gint64)lpca->width * lpca->height, k = lpca->n_clusters;
    const gint64 d = dimensions(lpca->n_views, lpca->n_lights), c = lpca->n_components;
    const gint64 value = lpca->quantise == LPCA_FLOAT ? 4 : 2;
    const gint64 brdfs =
        lpca->quantise == LPCA_8BIT ? k * (2 * d + c * (d + 4)) : k * (c + 1) * d * value;
    return texels * ((k > 256 ? 2 : 1) + c * value) + brdfs;
}
