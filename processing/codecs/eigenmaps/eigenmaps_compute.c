#include <cblas.h>
#include <lapacke.h>
#include <math.h>

#include "eigenmaps_private.h"

#include "base/data_error.h"
#include "base/plural.h"

#define CHUNK   EIGENMAPS_CHUNK
#define COLOURS 3

/* Reads one column of A: the values of all texels and lights in one view, job->rows = n_lights ×
 * n_texels × COLOURS. */
gboolean eigenmaps_get_column(const struct eigenmaps_job *job, int view, float *ret,
                              GError **error) {
    if (!job->column(view, ret, job->data, error))
        return FALSE;
    for (gsize i = 0; i < job->rows; i++)
        if (!isfinite(ret[i])) {
            const gsize texels = btf_layout_texels(&job->maps->layout);
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "a value of view %d, light %zu and texel %zu, all counted from 0, is "
                        "infinite or not a number; make the BTF of this view again",
                        view, i / COLOURS / texels, i / COLOURS % texels);
            return FALSE;
        }
    return TRUE;
}

float *eigenmaps_new_columns(const struct eigenmaps_job *job, int n, GError **error) {
    float *ret = g_try_new(float, job->rows *(gsize)n);
    if (!ret)
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "there is no memory for %d maps or views of %" G_GSIZE_FORMAT
            " values each; allow fewer bytes with --memory, or make the BTF with fewer texels",
            n, job->rows);
    return ret;
}

/* Converts rows to doubles for the products, because AᵀA in floats would lose the last eigen-maps.
 * Only CHUNK rows are converted at a time, to save memory. `to` is n_columns × CHUNK. */
gsize eigenmaps_widen(const float *columns, gsize rows, int n_columns, gsize from, double *to) {
    gsize n = MIN(CHUNK, rows - from);
    for (int c = 0; c < n_columns; c++)
        for (gsize i = 0; i < n; i++)
            to[(gsize)c * CHUNK + i] = columns[(gsize)c * rows + from + i];
    return n;
}

/* Replaces the matrix M = V diag (λ) Vᵀ by V. The columns of V are in ascending order of λ. */
gboolean eigenmaps_eigenvectors(double *matrix, int n, double *ret_values, GError **error) {
    int info = LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'V', 'U', n, matrix, n, ret_values);
    if (info != 0)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the eigen-maps cannot be computed (LAPACK's dsyev failed on a matrix of %d × "
                    "%d with code %d); check the BTF for extremely large values",
                    n, n, info);
    return info == 0;
}

/* The error of k terms is √(Σ_{i≥k} σ_i² / Σ_i σ_i²). squares has the σ_i² of the first n terms in
 * descending order. rest is the sum of the σ_i² of all later terms. */
int eigenmaps_fewest(const double *squares, int n, double rest, double target, double *ret_error) {
    double all = rest;
    for (int i = n - 1; i >= 0; i--)
        all += squares[i];
    for (; target > 0 && n > 1 && rest + squares[n - 1] <= target * target * all; n--)
        rest += squares[n - 1];
    *ret_error = all > 0 ? sqrt(MAX(rest, 0) / all) : 0;
    return n;
}

gboolean eigenmaps_missed(const struct eigenmaps_job *job, double reached, GError **error) {
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached: with %d %s it is %.3g %%; allow more "
                "eigen-maps or a larger error",
                100 * job->options->target, PLURAL(job->maps->n_terms, "eigen-map"), 100 * reached);
    return FALSE;
}

/* Stores the weights: one right singular vector for each term, n_terms × n_views in rows. The sign
 * of a term is arbitrary. The weight with the largest magnitude is made positive, so that the same
 * BTF gives the same file on every computer. */
void eigenmaps_take_weights(struct eigenmaps *maps, const double *rows, double *ret_signs) {
    int n = maps->layout.views.n;
    g_free(maps->weights);
    maps->weights = g_new(float, (gsize)maps->n_terms *n);
    for (int term = 0; term < maps->n_terms; term++) {
        const double *row = rows + (gsize)term * n;
        int largest = 0;
        for (int view = 1; view < n; view++)
            if (fabs(row[view]) > fabs(row[largest]) * (1 + 1e-9))
                largest = view;
        double sign = row[largest] < 0 ? -1 : 1;
        for (int view = 0; view < n; view++)
            maps->weights[term * n + view] = (float)(sign * row[view]);
        if (ret_signs)
            ret_signs[term] = sign;
    }
}

gboolean eigenmaps_compute(struct eigenmaps *maps, EigenmapsColumn column, gpointer data,
                           double *ret_error, GError **error) {
    return eigenmaps_compute_with(maps, &(struct eigenmaps_options){0}, column, data, ret_error,
                                  error);
}

gboolean eigenmaps_compute_with(struct eigenmaps *maps, const struct eigenmaps_options *options,
                                EigenmapsColumn column, gpointer data, double *ret_error,
                                GError **error) {
    if (maps->n_terms < 1 || (gsize)maps->n_terms > maps->layout.views.n) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "a BTF of %zu views cannot have %d eigen-maps; give a number from 1 to %zu",
                    maps->layout.views.n, maps->n_terms, maps->layout.views.n);
        return FALSE;
    }
    if (!isfinite(options->target) || options->target < 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "eigen-maps cannot have a maximum error of %g; give an error above 0, or 0 for "
                    "no maximum",
                    options->target);
        return FALSE;
    }
    struct eigenmaps_job job = {maps, options, column, data};
    job.rows = btf_layout_texels(&maps->layout) * COLOURS * maps->layout.lights.n;
    job.fit = MAX(
        (options->memory > 0 ? options->memory : EIGENMAPS_MEMORY) / (job.rows * sizeof(float)), 1);
    const gboolean exact = !options->folder &&
                           (options->method == EIGENMAPS_EXACT ||
                            (options->method == EIGENMAPS_AUTO && job.fit >= maps->layout.views.n));
    g_clear_pointer(&maps->weights, g_free);
    g_clear_pointer(&maps->maps, g_free);
    g_clear_pointer(&maps->file, scratch_file_free);
    /* BLAS uses one thread, because with more the last bits of the sums would depend on the number
     * of threads. */
    int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    gboolean ok = exact ? eigenmaps_exact(&job, ret_error, error)
                        : eigenmaps_randomised(&job, ret_error, error);
    openblas_set_num_threads(threads);
    return ok;
}
