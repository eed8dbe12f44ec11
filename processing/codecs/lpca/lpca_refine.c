#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "lpca_pack.h"
#include "lpca_private.h"

#define COLOURS 3
#define CERTAIN 2e-5 /* residuals below this part of ‖X − mean‖² are only rounding errors */

/* The run's texels of a block, sorted by cluster: the texels of cluster k are texels[starts[k]] …
 * texels[starts[k + 1] − 1]. */
struct groups {
    int from, n;
    int texels[LPCA_BLOCK];
    int indices[LPCA_BLOCK]; /* indices[i] is the position of texel from + i in texels[] */
    int *starts;             /* position in texels at which each cluster begins: clusters + 1 */
};

/* The matrices of a cluster of n texels:
 *   X  rows minus the cluster's mean, n × d
 *   P  coordinates of the rows in few dimensions, n × c
 *   E  eigen-BRDFs, c × d
 *   W  weights, n × c */
struct refine {
    struct lpca_run *run;
    const struct lpca_reduced *reduced; /* NULL when it is no longer needed */
    struct lpca *lpca;                  /* the result; its weights are first P, then W */
    /* if TRUE, W = X Eᵀ, for which the BTF is read once more; otherwise W follows from P */
    gboolean weigh;
    double *squares; /* views × clusters: Σ ‖x − run->mean‖² of the rows x in a view */
    /* c × c per cluster. Holds one after the other PᵀP, the matrix that turns P into W, Σ w wᵀ and
     * Uᵀ. */
    double *rotations;
    /* two per cluster: ‖X − W E‖², and Σ ‖x‖² of the rows x themselves */
    double *residual;
    double *sums; /* two per block: ‖X − X̂‖² and ‖X‖², see compare_block() */
};

/* Sorts the block's texels by cluster (counting sort). */
static void group(const struct refine *refine, int block, struct groups *ret) {
    const int from = refine->run->first + block * LPCA_BLOCK, k = refine->lpca->n_clusters;
    const int *labels = refine->lpca->clusters + from;
    ret->from = from;
    ret->n = MIN(LPCA_BLOCK, refine->run->end - from);
    ret->starts = g_new0(int, k + 2);
    for (int i = 0; i < ret->n; i++)
        ret->starts[labels[i] + 2]++;
    for (int i = 0; i < k; i++)
        ret->starts[i + 2] += ret->starts[i + 1];
    for (int i = 0; i < ret->n; i++) {
        ret->indices[i] = ret->starts[labels[i] + 1]++;
        ret->texels[ret->indices[i]] = from + i;
    }
}

static int blocks(const struct lpca_run *run) {
    return (run->end - run->first + LPCA_BLOCK - 1) / LPCA_BLOCK;
}

/* Gathers the rows of the block's texels in a view, in the order of the groups, minus the
 * subtrahend of their cluster. The subtrahends of consecutive clusters are `stride` floats apart.
 * If stride is 0, all clusters have the same subtrahend. */
static void gather(const struct refine *refine, const struct groups *groups, int view,
                   const float *subtrahend, gsize stride, float *ret) {
    struct lpca_run *run = refine->run;
    const gsize columns = (gsize)run->columns;
    lpca_run_place_rows(run, view, groups->from, groups->n, groups->indices, ret);
    for (int i = 0; i < groups->n; i++) {
        float *row = ret + (gsize)i * columns;
        const float *minus = subtrahend + (gsize)view * columns +
                             (gsize)refine->lpca->clusters[groups->texels[i]] * stride;
        for (gsize j = 0; j < columns; j++)
            row[j] -= minus[j];
    }
}

/* Computes the products of the texels' rows with their cluster's axes in few dimensions. */
static void reduced_block(int block, gpointer data) {
    const struct refine *refine = data;
    const int from = refine->run->first + block * LPCA_BLOCK;
    lpca_reduced_weights(refine->reduced, refine->lpca->clusters, from,
                         MIN(from + LPCA_BLOCK, refine->run->end), refine->lpca->weights);
}

/* Adds the sum of n rows to sums (columns), and the sum of their squared norms to *squares. part is
 * a buffer. */
static void add_rows(const float *rows, int n, gsize columns, float *part, double *sums,
                     double *squares) {
    memset(part, 0, sizeof(float) * columns);
    for (int i = 0; i < n; i++) {
        const float *row = rows + (gsize)i * columns;
        for (gsize j = 0; j < columns; j++)
            part[j] += row[j];
        *squares += cblas_sdot((int)columns, row, 1, row, 1);
    }
    for (gsize j = 0; j < columns; j++)
        sums[j] += part[j];
}

/* For each cluster, sums the rows of a view over its texels, and sums the rows times their products
 * with each axis. The mean of these products is 0, so that the cluster's mean need not be
 * subtracted from the rows. */
static void sum_view(int view, gpointer data) {
    const struct refine *refine = data;
    struct lpca_run *run = refine->run;
    struct lpca *lpca = refine->lpca;
    const int c = lpca->n_components;
    const gsize columns = (gsize)run->columns, at = (gsize)view * columns;
    g_autofree float *rows = g_new(float, LPCA_BLOCK *columns);
    g_autofree float *factors = g_new(float, LPCA_BLOCK *(gsize)c);
    g_autofree float *part = g_new(float, columns);
    g_autofree double *sums = g_new0(double, (gsize)lpca->n_clusters *columns);
    double *squares = refine->squares + (gsize)view * (gsize)lpca->n_clusters;
    /* An earlier run that was interrupted in this view may have left values. */
    if (run->done)
        memset(squares, 0, sizeof(double) * (gsize)lpca->n_clusters);
    for (int i = 0; run->done && i < lpca->n_clusters * (c + 1); i++)
        memset(lpca_brdf(lpca, 0, i) + at, 0, sizeof(float) * columns);
    for (int block = 0; block < blocks(run); block++) {
        struct groups groups;
        group(refine, block, &groups);
        gather(refine, &groups, view, run->mean, 0, rows);
        for (int i = 0; i < groups.n; i++)
            memcpy(factors + (gsize)(i * c), lpca->weights + (gsize)groups.texels[i] * (gsize)c,
                   sizeof(float) * (gsize)c);
        for (int k = 0; k < lpca->n_clusters; k++) {
            const int first = groups.starts[k], n = groups.starts[k + 1] - first;
            if (n == 0)
                continue;
            add_rows(rows + (gsize)first * columns, n, columns, part, sums + (gsize)k * columns,
                     squares + k);
            cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, c, run->columns, n, 1,
                        factors + (gsize)(first * c), c, rows + (gsize)first * columns,
                        run->columns, 1, lpca_brdf(lpca, k, 1) + at, run->d);
        }
        g_free(groups.starts);
    }
    for (int k = 0; k < lpca->n_clusters; k++)
        for (gsize j = 0; j < columns; j++)
            lpca_brdf(lpca, k, 0)[at + j] = (float)sums[(gsize)k * columns + j];
}

/* Computes the mean of cluster k, E_0 = a + off. a is the run's mean, and off = Σ (x − a) / n over
 * the cluster's n rows x. Also computes the residual of the mean without components, and Σ ‖x‖²:
 *   Σ ‖x − E_0‖² = Σ ‖x − a‖² − n ‖off‖²
 *   Σ ‖x‖² = Σ ‖x − a‖² + n ⟨a, 2 off + a⟩ */
static void finish_mean(const struct refine *refine, int k) {
    const GArray *members = g_ptr_array_index(refine->reduced->members, k);
    const struct lpca_run *run = refine->run;
    const double n = members->len;
    float *mean = lpca_brdf(refine->lpca, k, 0);
    double *residual = refine->residual + (gsize)(2 * k), squares = 0;
    for (gsize view = 0; view < run->btf->layout.views.n; view++)
        squares += refine->squares[view * refine->lpca->n_clusters + k];
    residual[0] = residual[1] = squares;
    for (int j = 0; j < run->d; j++) {
        const double all = run->mean[j], off = mean[j] / n;
        residual[0] -= n * off * off;
        residual[1] += n * all * (2 * off + all);
        mean[j] = (float)(all + off);
    }
}

/* Solves S x = y for c right-hand sides y (c × c) in place, where S = PᵀP (c × c). Columns of P
 * that are (nearly) 0 are left out. */
static void solve_products(double *squares, double *y, int c) {
    double largest = 0;
    for (int i = 0; i < c; i++)
        largest = MAX(largest, squares[i * (c + 1)]);
    for (int i = 0; i < c; i++)
        if (!(squares[i * (c + 1)] > 1e-12 * largest)) {
            for (int j = 0; j < c; j++)
                squares[i * c + j] = squares[j * c + i] = y[i * c + j] = 0;
            squares[i * (c + 1)] = 1;
        }
    if (LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', c, c, squares, c, y, c) != 0)
        memset(y, 0, sizeof(double) * (gsize)c * (gsize)c);
}

/* Finds the eigen-BRDFs E of cluster k, the matrix that turns P into W, and the residual. P are the
 * products of the cluster's rows X with its axes, and PᵀX is known. The best approximation of X by
 * P is P (PᵀP)⁻¹ PᵀX = W E with E = orth(PᵀX). */
static void solve_cluster(const struct refine *refine, int k) {
    const int c = refine->lpca->n_components, d = refine->run->d;
    const gsize square = (gsize)c * (gsize)c;
    float *axes = lpca_brdf(refine->lpca, k, 1);
    double *rotation = refine->rotations + (gsize)k * square;
    g_autofree float *sums = g_memdup2(axes, sizeof(float) * (gsize)c * (gsize)d);
    g_autofree double *inverted = g_memdup2(rotation, sizeof(double) * square);
    g_autofree double *onto = g_new0(double, square), *solved = g_new0(double, square);
    lpca_orthonormalise(axes, c, d, TRUE);
    for (int i = 0; i < c; i++)
        for (int j = 0; j < c; j++)
            onto[i * c + j] =
                cblas_dsdot(d, sums + (gsize)i * (gsize)d, 1, axes + (gsize)j * (gsize)d, 1);
    memcpy(solved, onto, sizeof(double) * square);
    solve_products(inverted, solved, c);
    /* The part of ‖X‖² that W E explains is 2 ⟨X, WE⟩ − ‖WE‖². In this form, an error of W
     * enters only with its square. */
    double *missing = refine->residual + (gsize)(2 * k);
    g_autofree double *half = g_new(double, square);
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, c, c, c, 1, rotation, c, solved, c, 0,
                half, c);
    for (gsize i = 0; i < square; i++)
        *missing -= solved[i] * (2 * onto[i] - half[i]);
    for (int i = 0; i < c; i++)
        for (int j = 0; j < c; j++)
            rotation[i * c + j] = solved[j * c + i];
}

static void finish_cluster(int k, gpointer data) {
    const struct refine *refine = data;
    finish_mean(refine, k);
    if (refine->weigh)
        lpca_orthonormalise(lpca_brdf(refine->lpca, k, 1), refine->lpca->n_components,
                            refine->run->d, TRUE);
    else
        solve_cluster(refine, k);
}

/* Computes the products of the eigen-BRDFs and the rows minus their cluster's mean. */
static void weigh_block(int block, gpointer data) {
    const struct refine *refine = data;
    struct lpca_run *run = refine->run;
    struct lpca *lpca = refine->lpca;
    const int c = lpca->n_components;
    const gsize columns = (gsize)run->columns;
    const gsize stride = (gsize)(c + 1) * (gsize)run->d;
    struct groups groups;
    group(refine, block, &groups);
    g_autofree float *rows = g_new(float, (gsize)groups.n *columns);
    g_autofree float *weights = g_new0(float, groups.n *c);
    for (gsize view = 0; view < run->btf->layout.views.n; view++) {
        gather(refine, &groups, view, lpca->brdfs, stride, rows);
        for (int k = 0; k < lpca->n_clusters; k++) {
            const int first = groups.starts[k], n = groups.starts[k + 1] - first;
            if (n > 0)
                cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, c, run->columns, 1,
                            rows + (gsize)first * columns, run->columns,
                            lpca_brdf(lpca, k, 1) + (gsize)view * columns, run->d, 1,
                            weights + (gsize)(first * c), c);
        }
    }
    for (int i = 0; i < groups.n; i++)
        memcpy(lpca->weights + (gsize)groups.texels[i] * (gsize)c, weights + (gsize)(i * c),
               sizeof(float) * (gsize)c);
    g_free(groups.starts);
}

/* Returns Σ w wᵀ of each cluster, c × c, over the weights w of its texels. g_free() */
static double *covariances(const struct refine *refine) {
    const struct lpca *lpca = refine->lpca;
    const gsize c = (gsize)lpca->n_components, n = (gsize)lpca->n_clusters * c * c;
    const struct team *team = refine->run->options->team;
    double *ret = g_new0(double, n);
    for (int x = refine->run->first; x < refine->run->end; x++) {
        double *to = ret + (gsize)lpca->clusters[x] * c * c;
        const float *w = lpca->weights + (gsize)x * c;
        for (gsize i = 0; i < c; i++)
            for (gsize j = 0; j < c; j++)
                to[i * c + j] += (double)w[i] * w[j];
    }
    if (team)
        team->sum_doubles(team, ret, n);
    return ret;
}

/* Rotates the axes E of cluster k so that the components are uncorrelated and sorted by descending
 * variance. U are the eigenvectors of Σ w wᵀ (c × c): E ← Uᵀ E and w ← Uᵀ w. If all weights of a
 * component are 0, its E_i becomes 0. */
static void rotate_axes(int k, gpointer data) {
    const struct refine *refine = data;
    struct lpca *lpca = refine->lpca;
    const int c = lpca->n_components, d = refine->run->d;
    double *rotation = refine->rotations + (gsize)(k * c * c);
    float *axes = lpca_brdf(lpca, k, 1);
    g_autofree double *vectors = g_memdup2(rotation, sizeof(double) * (gsize)(c * c));
    g_autofree double *values = g_new0(double, c);
    g_autofree float *rows = g_new0(float, c *c);
    g_autofree float *old = g_memdup2(axes, sizeof(float) * (gsize)c * (gsize)d);
    if (LAPACKE_dsyev(LAPACK_COL_MAJOR, 'V', 'U', c, vectors, c, values) != 0)
        for (int i = 0; i < c * c; i++)
            vectors[i] = i % (c + 1) == c - 1 ? 1 : 0;
    for (int i = 0; i < c; i++)
        for (int j = 0; j < c; j++) {
            const gboolean used = values[c - 1 - i] > 1e-12 * values[c - 1];
            rotation[i * c + j] = used ? vectors[(c - 1 - i) * c + j] : 0;
            rows[i * c + j] = (float)rotation[i * c + j];
        }
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, c, d, c, 1, rows, c, old, d, 0, axes, d);
}

/* Replaces the weights w of each texel by T w. T is the c × c matrix of the texel's cluster, in
 * refine->rotations. */
static void rotate_weights(int block, gpointer data) {
    const struct refine *refine = data;
    const struct lpca_run *run = refine->run;
    struct lpca *lpca = refine->lpca;
    const gsize c = (gsize)lpca->n_components;
    const int from = run->first + block * LPCA_BLOCK;
    double old[LPCA_MAX_PACKED];
    for (int x = from; x < MIN(from + LPCA_BLOCK, run->end); x++) {
        const double *rotation = refine->rotations + (gsize)lpca->clusters[x] * c * c;
        float *w = lpca->weights + (gsize)x * c;
        for (gsize i = 0; i < c; i++)
            old[i] = w[i];
        for (gsize i = 0; i < c; i++) {
            double sum = 0;
            for (gsize j = 0; j < c; j++)
                sum += rotation[i * c + j] * old[j];
            w[i] = (float)sum;
        }
    }
}

/* Finds means and E of all clusters: sums over the views, then finishes each cluster. */
static gboolean sum_views(struct refine *refine, GError **error) {
    struct lpca_run *run = refine->run;
    const struct lpca *lpca = refine->lpca;
    const struct team *team = run->options->team;
    lpca_keep(run, LPCA_KEPT_SQUARES, refine->squares);
    lpca_keep_blocks(run, run->btf->layout.views.n);
    work_for_each(run->options->work.n_threads, blocks(run), reduced_block, refine);
    if (!lpca_run_blocks(run, "refine", run->btf->layout.views.n, sum_view, refine, error))
        return FALSE;
    lpca_drop_blocks(run);
    if (team) {
        team->sum_floats(team, lpca->brdfs,
                         (gsize)lpca->n_clusters * (gsize)(lpca->n_components + 1) * (gsize)run->d);
        team->sum_doubles(team, refine->squares,
                          (gsize)run->btf->layout.views.n * (gsize)lpca->n_clusters);
    }
    if (!refine->weigh)
        refine->rotations = covariances(refine);
    work_for_each(run->options->work.n_threads, lpca->n_clusters, finish_cluster, refine);
    return TRUE;
}

/* Computes the relative error from ‖X − X̂‖² = ‖X‖² − 2 ⟨X, WE⟩ + ‖WE‖² of each cluster. This avoids
 * reading the BTF once more. A very small error is lost in rounding, and lpca->error is then −1. */
static void sum_error(struct refine *refine) {
    double missing = 0, sum = 0, all = 0;
    for (int k = 0; k < refine->lpca->n_clusters; k++) {
        missing += refine->residual[2 * k];
        sum += refine->residual[2 * k + 1];
    }
    for (gsize i = 0; i < refine->run->btf->layout.views.n * refine->lpca->n_clusters; i++)
        all += refine->squares[i];
    refine->lpca->error = missing > CERTAIN * all ? sqrt(missing / sum) : -1;
}

/* Computes E and W from P. Skips the stages that an earlier run has completed in the checkpoint. */
static gboolean make(struct refine *refine, GError **error) {
    struct lpca_run *run = refine->run;
    struct lpca *lpca = refine->lpca;
    const int threads = run->options->work.n_threads;
    lpca_keep(run, LPCA_KEPT_BRDFS, lpca->brdfs);
    if (run->state.stage < LPCA_WEIGHING && !sum_views(refine, error))
        return FALSE;
    if (run->state.stage < LPCA_MADE) {
        if (!refine->weigh) {
            work_for_each(threads, blocks(run), rotate_weights, refine);
            sum_error(refine);
        } else {
            /* Each block of weights reads its texels of the BTF again. The checkpoint therefore
             * saves the blocks that are finished. */

            lpca_enter(run, LPCA_WEIGHING);
            lpca_keep(run, LPCA_KEPT_WEIGHTS, lpca->weights);
            lpca_keep_blocks(run, blocks(run));
            if (!lpca_run_blocks(run, "weights", blocks(run), weigh_block, refine, error))
                return FALSE;
            lpca_drop_blocks(run);
        }
        g_free(refine->rotations);
        refine->rotations = covariances(refine);
        work_for_each(threads, lpca->n_clusters, rotate_axes, refine);
        work_for_each(threads, blocks(run), rotate_weights, refine);
        lpca_share(run->options->team, lpca->weights, run->n, TEAM_ROWS,
                   sizeof(float) * (gsize)lpca->n_components);
        run->state.error = lpca->error;
        lpca_enter(run, LPCA_MADE);
    }
    lpca_keep(run, LPCA_KEPT_WEIGHTS, lpca->weights);
    lpca->error = run->state.error;
    return TRUE;
}

struct lpca *lpca_refine(struct lpca_run *run, const struct lpca_reduced *reduced, GError **error) {
    struct refine refine = {run, reduced, lpca_new(run->btf, reduced->k, reduced->c)};
    /* A packed file may have many axes. They are found from a sample, so that the last ones are not
     * accurate for all rows. W is then computed from the BTF, and not from P. */
    refine.weigh = reduced->c > LPCA_MAX_COMPONENTS || run->options->to_pack;
    refine.lpca->error = -1;
    refine.lpca->colours = run->options->colours;
    memcpy(refine.lpca->clusters, reduced->labels, sizeof(int) * (gsize)run->n);
    lpca_keep(run, LPCA_KEPT_LABELS, refine.lpca->clusters);
    refine.squares = g_new0(double, reduced->k * run->btf->layout.views.n);
    refine.residual = g_new0(double, 2 * reduced->k);
    if (!make(&refine, error))
        g_clear_pointer(&refine.lpca, lpca_free);
    g_free(refine.squares);
    g_free(refine.residual);
    g_free(refine.rotations);
    return refine.lpca;
}

/* Adds ‖X − X̂‖² and ‖X‖² of the texels of a block to the two sums of the block. X̂ = E_0 + W E. */
static void compare_block(int block, gpointer data) {
    const struct refine *refine = data;
    struct lpca_run *run = refine->run;
    const struct lpca *lpca = refine->lpca;
    const int c = lpca->n_components;
    const gsize columns = (gsize)run->columns;
    struct groups groups;
    group(refine, block, &groups);
    g_autofree float *buffer = g_new(float, (gsize)groups.n *columns);
    g_autofree float *sum = g_new0(float, (gsize)groups.n *columns);
    g_autofree float *weights = g_new0(float, groups.n *c);
    for (int i = 0; i < groups.n; i++)
        memcpy(weights + (gsize)(i * c), lpca->weights + (gsize)groups.texels[i] * (gsize)c,
               sizeof(float) * (gsize)c);
    for (gsize view = 0; view < run->btf->layout.views.n; view++) {
        const gsize at = (gsize)view * columns;
        for (int k = 0; k < lpca->n_clusters; k++) {
            const int first = groups.starts[k], n = groups.starts[k + 1] - first;
            for (int i = first; i < first + n; i++)
                memcpy(sum + (gsize)i * columns, lpca_brdf(lpca, k, 0) + at,
                       sizeof(float) * columns);
            if (n > 0)
                cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, run->columns, c, 1,
                            weights + (gsize)(first * c), c, lpca_brdf(lpca, k, 1) + at, run->d, 1,
                            sum + (gsize)first * columns, run->columns);
        }
        if (lpca->colours == LPCA_LOG)
            lpca_from_log(sum, (gsize)groups.n * columns / COLOURS);
        gsize stride;
        const int from = run->first + block * LPCA_BLOCK;
        const float *rows = lpca_run_rows(run, view, from, groups.n, buffer, &stride);
        /* sums[0]: sum of squared errors; sums[1]: sum of squared values; both over R, G and B
         * together */
        double *sums = refine->sums + (gsize)(2 * block);
        for (int i = 0; i < groups.n; i++)
            for (gsize j = 0; j < columns; j++) {
                const double should = rows[(gsize)(groups.texels[i] - from) * stride + j];
                const double rest = (double)sum[(gsize)i * columns + j] - should;
                sums[0] += rest * rest;
                sums[1] += should * should;
            }
    }
    g_free(groups.starts);
}

gboolean lpca_run_error(struct lpca_run *run, struct lpca *lpca, GError **error) {
    const struct lpca_options *options = run->options;
    struct lpca_options plain = *options; /* the comparison is in R, G, B */
    struct refine refine = {run, NULL, lpca};
    double sums[2] = {0};
    refine.sums = g_new0(double, 2 * blocks(run) + 1);
    plain.colours = LPCA_RGB;
    run->options = &plain;
    const gboolean ok = lpca_run_blocks(run, "check", blocks(run), compare_block, &refine, error);
    run->options = options;
    for (int i = 0; i < 2 * blocks(run); i++)
        sums[i % 2] += refine.sums[i];
    if (options->team)
        options->team->sum_doubles(options->team, sums, 2);
    lpca->error = sums[1] > 0 ? sqrt(sums[0] / sums[1]) : 0;
    g_free(refine.sums);
    return ok;
}

gboolean lpca_error_shared(struct lpca *lpca, const struct btf_matrix *btf,
                           const struct lpca_options *options, GError **error) {
    struct lpca_run run = {.btf = btf, .options = options, .n = btf_layout_texels(&btf->layout)};
    run.d = (int)btf_layout_values(&btf->layout);
    run.columns = run.d / btf->layout.views.n;
    team_part(options->team, options->team ? options->team->rank : 0, run.n, TEAM_ROWS, &run.first,
              &run.end);
    g_mutex_init(&run.lock);
    const gboolean ok = lpca_run_error(&run, lpca, error);
    g_mutex_clear(&run.lock);
    g_clear_error(&run.failed);
    return ok;
}

double lpca_error(struct lpca *lpca, const struct btf_matrix *btf, int n_threads) {
    const struct lpca_options options = {.work.n_threads = n_threads};
    g_autoptr(GError) error = NULL;
    if (!lpca_error_shared(lpca, btf, &options, &error))
        lpca->error = NAN;
    return lpca->error;
}
