/* What eigenmaps*.c share. */
#pragma once

#include "eigenmaps.h"

#define EIGENMAPS_CHUNK 2048 /* rows multiplied at a time, in double precision */

/* A computation on the matrix A (rows × n_views), which is read by columns. */
struct eigenmaps_job {
    struct eigenmaps *maps;
    const struct eigenmaps_options *options;
    EigenmapsColumn column;
    gpointer data;
    gsize rows;
    gsize fit; /* columns that fit into memory, at least 1 */
};

/* A column, or an error if a value in it is not a number. */
gboolean eigenmaps_get_column(const struct eigenmaps_job *job, int view, float *ret,
                              GError **error);

/* Memory for n columns, or an error. */
float *eigenmaps_new_columns(const struct eigenmaps_job *job, int n, GError **error);

/* Converts up to EIGENMAPS_CHUNK rows of all columns, from row `from` on, to doubles. Column i
 * begins at columns + i · rows, and its doubles at to + i · EIGENMAPS_CHUNK. Returns the number of
 * rows converted. */
gsize eigenmaps_widen(const float *columns, gsize rows, int n_columns, gsize from, double *to);

/* Replaces a symmetric n × n matrix, given by its upper half, by its eigenvectors, in columns by
 * ascending eigenvalues. */
gboolean eigenmaps_eigenvectors(double *matrix, int n, double *ret_values, GError **error);

/* Returns the fewest of n terms, at least 1, whose error is at most the target; n if target is 0.
 * squares: the squared norm of each term, descending; rest: the squared norm of what all n terms
 * leave. *ret_error is the error of the terms returned. */
int eigenmaps_fewest(const double *squares, int n, double rest, double target, double *ret_error);

/* Weights of maps->n_terms terms from rows of n_views, each with its largest entry made positive;
 * signs (n_terms) may be NULL. */
void eigenmaps_take_weights(struct eigenmaps *maps, const double *rows, double *ret_signs);

/* "an error of … is not reached". */
gboolean eigenmaps_missed(const struct eigenmaps_job *job, double reached, GError **error);

gboolean eigenmaps_exact(const struct eigenmaps_job *job, double *ret_error, GError **error);
gboolean eigenmaps_randomised(const struct eigenmaps_job *job, double *ret_error, GError **error);
