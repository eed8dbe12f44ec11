#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/plural.h"
#include "lpca_pack.h"
#include "lpca_private.h"

#define SEED    7
#define SAMPLES 768 /* minimum number of texels whose span is used for clustering */
#define REDUCED 128 /* minimum number of dimensions of the space in which texels are clustered */
#define TILE    128 /* rows and columns of the Gram matrix that are computed at a time */
#define STRIP   256 /* columns of the axes that are computed at a time */
#define COLOURS 3

/* Decomposes rows = R Q by Householder's method. |R_ii| is the norm of the part of row i that is
 * orthogonal to the rows before it. */
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

/* Sets rows that could not be read to 0. Keeps `failed` in run->failed if it is the first error.
 * Takes ownership of `failed`. */
static void unreadable(struct lpca_run *run, GError *failed, float *rows, gsize values) {
    g_mutex_lock(&run->lock);
    if (!run->failed)
        run->failed = g_steal_pointer(&failed);
    g_mutex_unlock(&run->lock);
    g_clear_error(&failed);
    memset(rows, 0, sizeof(float) * values);
}

void lpca_run_place_rows(struct lpca_run *run, int view, int texel, int n, const int *indices,
                         float *ret) {
    GError *failed = NULL;
    const gsize values = (gsize)n * (gsize)run->columns;
    if (!btf_matrix_place_rows(run->btf, view, texel - run->first, n, indices, ret, &failed))
        unreadable(run, failed, ret, values);
    else if (run->options->colours == LPCA_LOG)
        lpca_to_log(ret, values / COLOURS);
}

const float *lpca_run_rows(struct lpca_run *run, int view, int texel, int n, float *buffer,
                           gsize *ret_stride) {
    GError *failed = NULL;
    const gsize columns = (gsize)run->columns, values = (gsize)n * columns;
    const float *rows =
        btf_matrix_rows(run->btf, view, texel - run->first, n, buffer, ret_stride, &failed);
    if (!rows) {
        unreadable(run, failed, buffer, values);
        *ret_stride = columns;
        return buffer;
    }
    if (run->options->colours == LPCA_RGB)
        return rows;
    for (gsize i = 0; rows != buffer && i < (gsize)n; i++)
        memcpy(buffer + i * columns, rows + i * *ret_stride, sizeof(float) * columns);
    lpca_to_log(buffer, values / COLOURS);
    *ret_stride = columns;
    return buffer;
}

struct stage {
    struct lpca_run *run;
    WorkBlock func;
    gpointer data;
};

/* Runs one block of a stage. Does nothing if the checkpoint has the block. After values could not
 * be read, in this block or another, no further block counts as done. */
static void stage_block(int block, gpointer data) {
    const struct stage *stage = data;
    struct lpca_run *run = stage->run;
    if (run->done && g_atomic_int_get(&run->done[block]))
        return;
    work_use_one_blas_thread();
    stage->func(block, stage->data);
    if (!run->done)
        return;
    g_mutex_lock(&run->lock);
    if (!run->failed)
        g_atomic_int_set(&run->done[block], 1);
    g_mutex_unlock(&run->lock);
}

static void tell_and_save(const struct work_progress *progress, gpointer data) {
    const struct lpca_options *options = data;
    if (options->work.progress)
        options->work.progress(progress, options->work.data);
    if (options->checkpoint)
        checkpoint_save_if_due(options->checkpoint);
}

gboolean lpca_run_blocks(struct lpca_run *run, const char *stage, int n, WorkBlock func,
                         gpointer data, GError **error) {
    struct work work = run->options->work;
    work.progress = tell_and_save;
    work.data = (gpointer)run->options;
    struct stage all = {run, func, data};
    const gboolean ended = work_parallel(&work, stage, n, stage_block, &all, error);
    if (ended && run->failed)
        g_propagate_error(error, g_error_copy(run->failed));
    if (ended && !run->failed)
        return TRUE;
    if (run->options->checkpoint)
        checkpoint_save(run->options->checkpoint);
    return FALSE;
}

/* The rows whose span is used for clustering. */
struct sample {
    struct lpca_run *run;
    int n;
    float *rows;    /* n × d, minus their mean */
    float *gram;    /* X Xᵀ of the rows X: n × n, lower half */
    int found;      /* number of axes */
    float *vectors; /* found × n: eigenvectors of the Gram matrix, see solve_gram() */
};

/* Returns all texels in an order whose first n texels are drawn at random. A regular choice could
 * coincide with the material's pattern. All ranks of a team draw the same texels. g_free() */
static int *draw_texels(const struct lpca_run *run, int n) {
    int *texels = g_new0(int, run->n);
    GRand *random = g_rand_new_with_seed(SEED);
    for (int i = 0; i < run->n; i++)
        texels[i] = i;
    for (int i = 0; i < n; i++) {
        const int other = g_rand_int_range(random, i, run->n), texel = texels[other];
        texels[other] = texels[i];
        texels[i] = texel;
    }
    g_rand_free(random);
    return texels;
}

static void read_sample(const struct sample *sample, const int *texels) {
    struct lpca_run *run = sample->run;
    const gsize columns = (gsize)run->columns, d = (gsize)run->d;
    g_autofree float *buffer = g_new(float, columns);
    for (int i = 0; i < sample->n; i++) {
        float *row = sample->rows + (gsize)i * d;
        gsize stride;
        for (gsize view = 0; view < run->btf->layout.views.n; view++)
            if (texels[i] >= run->first && texels[i] < run->end)
                memcpy(row + (gsize)view * columns,
                       lpca_run_rows(run, view, texels[i], 1, buffer, &stride),
                       sizeof(float) * columns);
    }
}

/* Computes one tile of the lower half of X Xᵀ. X is the sample, n × d. */
static void gram_tile(int block, gpointer data) {
    const struct sample *sample = data;
    const int n = sample->n, tiles = (n + TILE - 1) / TILE, d = sample->run->d;
    const int i = block / tiles * TILE, j = block % tiles * TILE;
    if (j > i)
        return;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, MIN(TILE, n - i), MIN(TILE, n - j), d, 1,
                sample->rows + (gsize)i * (gsize)d, d, sample->rows + (gsize)j * (gsize)d, d, 0,
                sample->gram + (gsize)i * (gsize)n + (gsize)j, n);
}

/* Computes a strip of columns of the axes: vectors (found × n) times X (n × d). */
static void axes_strip(int block, gpointer data) {
    const struct sample *sample = data;
    const int d = sample->run->d, from = block * STRIP;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, sample->found, MIN(STRIP, d - from),
                sample->n, 1, sample->vectors, sample->n, sample->rows + from, d, 0,
                sample->run->axes + from, d);
}

/* Finds the eigenvectors U of X Xᵀ = U diag (λ) Uᵀ, where X is the sample (n × d, n ≪ d). The
 * principal axes of the sample are the rows of diag (λ)^−½ Uᵀ X. Sets sample->vectors to diag
 * (λ)^−½ Uᵀ, the largest λ first. */
static gboolean solve_gram(struct sample *sample, GError **error) {
    const int m = sample->n, wanted = MIN(sample->run->r, m);
    g_autofree float *values = g_new0(float, m);
    g_autofree float *vectors = g_new0(float, (gsize)m *(gsize)wanted);
    g_autofree int *support = g_new0(int, 2 * m);
    int found = 0;
    /* In memory, the lower half by rows is the upper half by columns. */
    const int info = LAPACKE_ssyevr(LAPACK_COL_MAJOR, 'V', 'I', 'U', m, sample->gram, m, 0, 0,
                                    m - wanted + 1, m, 0, &found, values, vectors, m, support);
    if (info != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the principal axes of %d texels cannot be computed (the LAPACK function "
                    "ssyevr returned %d); check the BTF for extremely large values",
                    m, info);
        return FALSE;
    }
    sample->vectors = g_new(float, (gsize)m *(gsize)wanted);
    for (int i = 0; i < found && values[found - 1 - i] > 1e-7F * values[found - 1]; i++) {
        const float *from = vectors + (gsize)(found - 1 - i) * (gsize)m;
        const float size = sqrtf(values[found - 1 - i]);
        for (int j = 0; j < m; j++)
            sample->vectors[(gsize)i * (gsize)m + (gsize)j] = from[j] / size;
        sample->found = i + 1;
    }
    return TRUE;
}

/* Returns the number of reduced dimensions. It is larger than the number of components, because the
 * span of a sample of texels does not contain all components of all texels. The sample has at least
 * three times as many texels as there are reduced dimensions (samples_of()). */
static int reduced_to(int d, int n_components) {
    return MIN(d, MAX(REDUCED, n_components + n_components / 4));
}

static int samples_of(int texels, int r) {
    return MIN(texels, MAX(SAMPLES, 3 * r));
}

/* Sets run->mean and run->axes (r × d) to the mean and the principal axes of a sample of the
 * texels. */
static gboolean draw_axes(struct lpca_run *run, GError **error) {
    const struct team *team = run->options->team;
    const int threads = run->options->work.n_threads;
    struct sample sample = {run, samples_of(run->n, run->r)};
    const int n = sample.n, tiles = (n + TILE - 1) / TILE;
    const gsize d = (gsize)run->d;
    g_autofree int *texels = draw_texels(run, n);
    g_autofree double *sums = g_new0(double, d);
    sample.rows = g_new0(float, (gsize)n *d);
    sample.gram = g_new0(float, (gsize)n *(gsize)n);
    read_sample(&sample, texels);
    if (team)
        team->sum_floats(team, sample.rows, (gsize)n * d);
    for (int i = 0; i < n; i++)
        for (gsize j = 0; j < d; j++)
            sums[j] += sample.rows[(gsize)i * d + j];
    for (gsize j = 0; j < d; j++)
        run->mean[j] = (float)(sums[j] / n);
    for (int i = 0; i < n; i++)
        for (gsize j = 0; j < d; j++)
            sample.rows[(gsize)i * d + j] -= run->mean[j];
    work_for_each(threads, tiles * tiles, gram_tile, &sample);
    const gboolean ok = solve_gram(&sample, error);
    if (sample.found > 0) {
        work_for_each(threads, (run->d + STRIP - 1) / STRIP, axes_strip, &sample);
        lpca_orthonormalise(run->axes, sample.found, run->d, TRUE);
    }
    g_free(sample.rows);
    g_free(sample.gram);
    g_free(sample.vectors);
    return ok;
}

/* Reduces a block of texels: computes A (x − mean) = A x − offsets for the values x of each texel,
 * with the axes A. */
static void reduce_block(int block, gpointer data) {
    struct lpca_run *run = data;
    const int from = run->first + block * TEAM_ROWS, n = MIN(TEAM_ROWS, run->end - from);
    const gsize r = (gsize)run->r;
    float *to = run->rows + (gsize)from * r;
    g_autofree float *buffer = g_new(float, (gsize)n *(gsize)run->columns);
    for (gsize view = 0; view < run->btf->layout.views.n; view++) {
        const gsize at = (gsize)view * (gsize)run->columns;
        gsize stride;
        const float *rows = lpca_run_rows(run, view, from, n, buffer, &stride);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, run->r, run->columns, 1, rows,
                    (int)stride, run->axes + at, run->d, view > 0, to, run->r);
    }
    for (int i = 0; i < n; i++)
        for (gsize j = 0; j < r; j++)
            to[(gsize)i * r + j] -= run->offsets[j];
}

/* Sets run->rows (n × r) to the texels' values (n × d), reduced to r dimensions. Continues from the
 * checkpoint. */
static gboolean reduce(struct lpca_run *run, GError **error) {
    const int blocks = (run->end - run->first + TEAM_ROWS - 1) / TEAM_ROWS;
    run->mean = g_new(float, run->d);
    run->axes = g_new0(float, (gsize)run->r *(gsize)run->d);
    run->rows = g_new(float, (gsize)run->n *(gsize)run->r);
    run->offsets = g_new0(float, run->r);
    if (run->state.stage < LPCA_REDUCING) {
        if (!draw_axes(run, error))
            return FALSE;
        lpca_enter(run, LPCA_REDUCING);
    }
    lpca_keep(run, LPCA_KEPT_MEAN, run->mean);
    lpca_keep(run, LPCA_KEPT_ROWS, run->rows);
    if (run->state.stage > LPCA_REDUCING)
        return TRUE;
    lpca_keep(run, LPCA_KEPT_AXES, run->axes);
    lpca_keep_blocks(run, blocks);
    cblas_sgemv(CblasRowMajor, CblasNoTrans, run->r, run->d, 1, run->axes, run->d, run->mean, 1, 0,
                run->offsets, 1);
    if (!lpca_run_blocks(run, "reduce", blocks, reduce_block, run, error))
        return FALSE;
    lpca_drop_blocks(run);
    lpca_enter(run, LPCA_REDUCED);
    g_clear_pointer(&run->axes, g_free);
    lpca_share(run->options->team, run->rows, run->n, TEAM_ROWS, sizeof(float) * (gsize)run->r);
    return TRUE;
}

/* Clusters in the reduced space, then computes eigen-BRDFs and weights in all dimensions. */
static struct lpca *make(struct lpca_run *run, int n_components, GError **error) {
    struct lpca_reduced reduced = {.n = run->n,
                                   .r = run->r,
                                   .rows = run->rows,
                                   .options = run->options,
                                   .run = run,
                                   .k = run->options->n_clusters,
                                   .c = n_components};
    run->state.c = n_components;
    struct lpca *lpca = lpca_cluster(&reduced, error) ? lpca_refine(run, &reduced, error) : NULL;
    /* With LPCA_LOG, the error in R, G, B does not follow from the variance along the axes, and is
     * measured. */
    if (lpca && (lpca->colours == LPCA_LOG || lpca->error < 0) && !lpca_run_error(run, lpca, error))
        g_clear_pointer(&lpca, lpca_free);
    lpca_reduced_clear(&reduced);
    return lpca;
}

/* Finds by bisection the smallest number of components with which this clustering reaches the
 * target. state->few components are too few (0 at the start), and state->enough components reach
 * the target. */
static struct lpca *fewest(const struct lpca *lpca, struct lpca_run *run, GError **error) {
    struct lpca_state *state = &run->state;
    gboolean ok = TRUE;
    if (state->enough == 0) {
        state->enough = lpca->n_components;
        state->enough_error = lpca->error;
    }
    while (ok && state->enough > state->few + 1) {
        const int middle = (state->enough + state->few) / 2;
        g_autoptr(Lpca) fewer = lpca_truncated(lpca, middle);
        ok = lpca_run_error(run, fewer, error);
        if (ok && fewer->error <= run->options->target) {
            state->enough = middle;
            state->enough_error = fewer->error;
        } else if (ok) {
            state->few = middle;
        }
    }
    struct lpca *ret = ok ? lpca_truncated(lpca, state->enough) : NULL;
    if (ret)
        ret->error = state->enough_error;
    lpca_leave(run);
    return ret;
}

/* Doubles the number of components until they reach the target. If options->n_components do not
 * reach the target, sets *options->nearest and fails. */
static struct lpca *search(struct lpca_run *run, GError **error) {
    const struct lpca_options *options = run->options;
    for (int c = MAX(run->state.c, 1);; c = MIN(2 * c, options->n_components)) {
        g_autoptr(Lpca) lpca = make(run, c, error);
        if (!lpca)
            return NULL;
        if (lpca->error <= options->target)
            return fewest(lpca, run, error);
        lpca_enter(run, LPCA_REDUCED);
        if (c < options->n_components)
            continue;
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "an error of %.3g %% is not reached: with %d %s of %d %s it is %.3g %%; allow "
                    "more clusters or components",
                    100 * options->target, PLURAL(lpca->n_clusters, "cluster"),
                    PLURAL(lpca->n_components, "component"), 100 * lpca->error);
        if (options->nearest)
            *options->nearest =
                (struct lpca_nearest){lpca->n_clusters, lpca->n_components, lpca->error};
        return NULL;
    }
}

gint64 lpca_memory(const struct btf_matrix *btf, const struct lpca_options *options) {
    const gint64 n = btf_layout_texels(&btf->layout), k = options->n_clusters;
    const gint64 d = (int)btf_layout_values(&btf->layout), c = options->n_components;
    const gint64 r = reduced_to((int)d, (int)c), samples = samples_of((int)n, (int)r);
    const gint64 threads =
        options->work.n_threads > 0 ? options->work.n_threads : (gint64)g_get_num_processors();
    const gint64 reducing = samples * (d + samples) + 2 * samples * r;
    const gint64 clustering = 2 * n * (r + 2);
    const gint64 refining = 2 * k * (c + 1) * d + 2 * n * c;
    /* three copies of tables and weights in floats (one of them rotated), and two rounded copies
     * with integers */
    const gint64 packing = options->to_pack ? 7 * ((c + 1) * d + n * c) : 0;
    const gint64 buffers = threads * 2 * LPCA_BLOCK * (d / btf->layout.views.n + c);
    /* the checkpoint copies the arrays before it writes them */
    const gint64 kept = options->checkpoint ? n * (r + c + 1) + MAX(r, k * (c + 1)) * d : 0;
    return (gint64)sizeof(float) *
           (MAX(r * d + n * r + MAX(MAX(reducing, clustering), refining), packing) + buffers +
            kept);
}

/* Returns a number of bytes as text, rounded up, so that the size in the message is sufficient.
 * g_free() */
static char *format_need(gint64 bytes) {
    gint64 unit = 1;
    while (bytes / unit >= 1000)
        unit *= 1000;
    const gint64 step = MAX(unit / 10, 1);
    return g_format_size((guint64)((bytes + step - 1) / step * step));
}

/* Returns FALSE with an error that gives the necessary memory. */
static gboolean check_memory(const struct btf_matrix *btf, const struct lpca_options *options,
                             GError **error) {
    const gint64 least = lpca_memory(btf, options);
    if (options->memory <= 0 || least <= options->memory)
        return TRUE;
    /* If the values of the BTF are smaller than the memory for the work, the caller reads them into
     * memory. The limit must then include the values. */
    const gint64 values = btf_matrix_bytes(&btf->layout);
    g_autofree char *need = format_need(least + (values <= least ? values : 0));
    g_autofree char *given = g_format_size((guint64)(options->memory + (btf->values ? values : 0)));
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "%d %s of %d %s for %zu × %zu texels, %zu views and %zu lights take %s of memory, "
                "but --memory allows %s; allow more memory, or fewer clusters or components",
                PLURAL(options->n_clusters, "cluster"), PLURAL(options->n_components, "component"),
                btf->layout.width, btf->layout.height, btf->layout.views.n, btf->layout.lights.n,
                need, given);
    return FALSE;
}

static gboolean check_sizes(const struct btf_matrix *btf, const struct lpca_options *options,
                            GError **error) {
    const gint64 texels = btf_layout_texels(&btf->layout);
    const gint64 values = btf_layout_values(&btf->layout);
    const int most = options->to_pack ? LPCA_MAX_PACKED : LPCA_MAX_COMPONENTS;
    const char *what = NULL;
    if (!isfinite(options->target) || options->target < 0) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "a local PCA cannot have a maximum error of %g; give a number above 0, or 0 for "
            "no maximum",
            options->target);
        return FALSE;
    }
    if (texels < 1 || values < 1)
        what = "the BTF has no texels, no views or no lights";
    else if (texels > G_MAXINT / 2 || values > G_MAXINT / 2)
        what = "a BTF can have at most 1073741823 texels, and as many values of each texel";
    else if (options->n_clusters < 1 || options->n_clusters > MIN(texels, LPCA_MAX_CLUSTERS))
        what = "there can be 1 to 1024 clusters, at most one per texel";
    else if (options->n_components < 1 || options->n_components > MIN(values, most))
        what = options->to_pack
                   ? "there can be 1 to 512 components, at most one per value of a texel"
                   : "there can be 1 to 64 components, at most one per value of a texel";

    if (what)
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%d clusters of %d components for %zu × %zu texels, %zu views and %zu lights: %s",
            options->n_clusters, options->n_components, btf->layout.width, btf->layout.height,
            btf->layout.views.n, btf->layout.lights.n, what);
    return what == NULL && check_memory(btf, options, error);
}

/* Returns FALSE with an error if a value in memory is not finite. Values from a file are checked
 * when they are read. */
static gboolean check_values(const struct lpca_run *run, GError **error) {
    const gsize d = (gsize)run->d, n = (gsize)(run->end - run->first) * d;
    for (gsize i = 0; run->btf->values && i < n; i++)
        if (!isfinite(run->btf->values[i])) {
            const int texel = run->first + (int)(i / d);
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "a value of view %d in the texel of column %zu and row %zu, all counted "
                        "from 0, is infinite or not a number; "
                        "make the BTF of this view again",
                        (int)(i % d) / run->columns, texel % run->btf->layout.width,
                        texel / run->btf->layout.width);
            return FALSE;
        }
    return TRUE;
}

struct lpca *lpca_compute(const struct btf_matrix *btf, const struct lpca_options *options,
                          GError **error) {
    struct lpca *lpca = NULL;
    g_return_val_if_fail(!options->team || !options->checkpoint, NULL);
    if (!check_sizes(btf, options, error))
        return NULL;
    struct lpca_run run = {.btf = btf, .options = options, .n = btf_layout_texels(&btf->layout)};
    run.d = (int)btf_layout_values(&btf->layout);
    run.columns = run.d / btf->layout.views.n;
    run.r = reduced_to(run.d, options->n_components);
    team_part(options->team, options->team ? options->team->rank : 0, run.n, TEAM_ROWS, &run.first,
              &run.end);
    if (!check_values(&run, error))
        return NULL;
    g_mutex_init(&run.lock);
    /* BLAS uses one thread, because with more the last bits of the sums would depend on the number
     * of threads. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    lpca_resume(&run);
    if (reduce(&run, error))
        lpca = options->target > 0 ? search(&run, error) : make(&run, options->n_components, error);
    openblas_set_num_threads(threads);
    lpca_leave(&run);
    g_mutex_clear(&run.lock);
    g_clear_error(&run.failed);
    g_free(run.mean);
    g_free(run.axes);
    g_free(run.offsets);
    g_free(run.rows);
    return lpca;
}
