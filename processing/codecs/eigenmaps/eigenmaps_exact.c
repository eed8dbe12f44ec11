#include <cblas.h>

#include "eigenmaps_private.h"

#define CHUNK EIGENMAPS_CHUNK

/* The computation of AᵀA. Memory holds the columns of one block of views. If the block does not
 * have all views, memory also holds one further column. */
struct gram {
    const struct eigenmaps_job *job;
    gsize rows;
    int n_views, block; /* block: number of columns in memory at a time */
    float *columns;     /* columns of the block, `rows` values each; then the further column */
    double *matrix;     /* AᵀA, n_views × n_views */
};

/* If view is −1, adds to the matrix the products of the n columns of the block with each other.
 * Otherwise, adds the products of these columns with column `view` of A, which is stored after the
 * block. `first` is the index in A of the block's first column. */
static void multiply(const struct gram *gram, int first, int n, int view) {
    const int all = view < 0 ? n : n + 1;
    g_autofree double *wide = g_new(double, (gsize)all *CHUNK);
    double *last = wide + (gsize)n * CHUNK;
    double *to = gram->matrix + (gsize)first * gram->n_views;
    for (gsize from = 0; from < gram->rows; from += CHUNK) {
        const int rows = (int)eigenmaps_widen(gram->columns, gram->rows, n, from, wide);
        if (view < 0) {
            cblas_dsyrk(CblasRowMajor, CblasUpper, CblasNoTrans, n, rows, 1, wide, CHUNK, 1,
                        to + first, gram->n_views);
            continue;
        }
        eigenmaps_widen(gram->columns + gram->rows * (gsize)gram->block, gram->rows, 1, from, last);
        cblas_dgemv(CblasRowMajor, CblasNoTrans, n, rows, 1, wide, CHUNK, last, 1, 1, to + view,
                    gram->n_views);
    }
}

/* Computes the upper half of AᵀA (n_views²) block by block. The columns to the right of a block are
 * read one at a time, so that A is read about n_views / block / 2 times. */
static gboolean gram_matrix(struct gram *gram, GError **error) {
    for (int first = 0; first < gram->n_views; first += gram->block) {
        int n = MIN(gram->block, gram->n_views - first);
        float *other = gram->columns + gram->rows * (gsize)gram->block;
        for (int i = 0; i < n; i++)
            if (!eigenmaps_get_column(gram->job, first + i, gram->columns + gram->rows * (gsize)i,
                                      error))
                return FALSE;
        multiply(gram, first, n, -1);
        for (int view = first + n; view < gram->n_views; view++) {
            if (!eigenmaps_get_column(gram->job, view, other, error))
                return FALSE;
            multiply(gram, first, n, view);
        }
    }
    return TRUE;
}

/* Computes the maps E_i = Σ_v W_i(v) A_v, where A_v is the column of view v. Columns and maps are
 * n_lights × n_texels × RGB. */
static gboolean project_columns(const struct gram *gram, GError **error) {
    struct eigenmaps *maps = gram->job->maps;
    maps->maps = g_new0(float, gram->rows *(gsize)maps->n_terms);
    for (gsize view = 0; view < maps->layout.views.n; view++) {
        const float *column = gram->columns + gram->rows * (gsize)view;
        if (gram->block < gram->n_views) {
            if (!eigenmaps_get_column(gram->job, view, gram->columns, error))
                return FALSE;
            column = gram->columns;
        }
        for (int term = 0; term < maps->n_terms; term++) {
            float weight = maps->weights[term * maps->layout.views.n + view];
            float *map = maps->maps + gram->rows * (gsize)term;
            for (gsize i = 0; i < gram->rows; i++)
                map[i] += weight * column[i];
        }
    }
    return TRUE;
}

/* Decomposes AᵀA = V diag (σ²) Vᵀ. The weights are the first columns of V, and the maps are A V. */
static gboolean decompose(struct gram *gram, double *ret_error, GError **error) {
    struct eigenmaps *maps = gram->job->maps;
    const int n = maps->layout.views.n;
    const double target = gram->job->options->target;
    g_autofree double *values = g_new0(double, n), *squares = g_new0(double, n);
    g_autofree double *rows = g_new0(double, (gsize)n *n);
    double rest = 0;
    if (!gram_matrix(gram, error) || !eigenmaps_eigenvectors(gram->matrix, n, values, error))
        return FALSE;
    for (int i = 0; i < n; i++) {
        squares[i] = MAX(values[n - 1 - i], 0);
        for (int view = 0; view < n; view++)
            rows[(gsize)i * n + view] = gram->matrix[(gsize)view * n + (n - 1 - i)];
    }
    for (int i = n - 1; i >= maps->n_terms; i--)
        rest += squares[i];
    const int terms = eigenmaps_fewest(squares, maps->n_terms, rest, target, ret_error);
    if (target > 0 && *ret_error > target)
        return eigenmaps_missed(gram->job, *ret_error, error);
    maps->n_terms = terms;
    eigenmaps_take_weights(maps, rows, NULL);
    return project_columns(gram, error);
}

gboolean eigenmaps_exact(const struct eigenmaps_job *job, double *ret_error, GError **error) {
    struct gram gram = {job, job->rows, job->maps->layout.views.n};
    gram.block = (int)MIN(job->fit, (gsize)gram.n_views);
    gram.columns = eigenmaps_new_columns(job, gram.block + (gram.block < gram.n_views), error);
    gram.matrix = g_new0(double, (gsize)gram.n_views *gram.n_views);
    const gboolean ok = gram.columns && decompose(&gram, ret_error, error);
    g_free(gram.columns);
    g_free(gram.matrix);
    return ok;
}
