/* eigenmaps_compute.c, eigenmaps_exact.c and eigenmaps_randomised.c share these functions. */
#pragma once

#include "eigenmaps.h"

/* number of rows that are converted to doubles and multiplied at a time */
#define EIGENMAPS_CHUNK 2048

/* A computation on the matrix A (rows × n_views), which is read by columns. */
struct eigenmaps_job {
    struct eigenmaps *maps;
    const struct eigenmaps_options *options;
    EigenmapsColumn column;
    gpointer data;
    gsize rows;
    gsize fit; /* number of columns that fit into memory, at least 1 */
};

/* Reads a column of A. Fails if a value of the column is infinite or not a number. */
gboolean eigenmaps_get_column(const struct eigenmaps_job *job, int view, float *ret,
                              GError **error);

/* Allocates memory for n columns. Returns NULL with an error if there is not enough. */
float *eigenmaps_new_columns(const struct eigenmaps_job *job, int n, GError **error);

/* Converts up to EIGENMAPS_CHUNK rows of all columns to doubles, beginning with the row `from`.
 * Column i begins at `columns` + i · `rows`. The doubles of column i begin at `to` + i ·
 * EIGENMAPS_CHUNK. Returns the number of rows that were converted. */
gsize eigenmaps_widen(const float *columns, gsize rows, int n_columns, gsize from, double *to);

/* Replaces a symmetric n × n matrix, given by its upper half, by its eigenvectors. The eigenvectors
 * are its columns. ret_values has the n eigenvalues. Both are in ascending order of the
 * eigenvalues. Fails if the LAPACK function does. */
gboolean eigenmaps_eigenvectors(double *matrix, int n, double *ret_values, GError **error);

/* Returns the smallest number of terms, at least 1, whose relative error is at most target. Returns
 * n if target is 0, or if the error of all n terms is larger. squares are the squared norms of the
 * terms, descending. rest is the squared norm of the remainder after all n terms. *ret_error is the
 * error of the returned number of terms. */
int eigenmaps_fewest(const double *squares, int n, double rest, double target, double *ret_error);

/* Sets the weights of maps->n_terms terms from rows of n_views. If the entry of a row with the
 * largest magnitude is negative, the row is multiplied by −1. ret_signs (n_terms, may be NULL) are
 * the factors 1 and −1. */
void eigenmaps_take_weights(struct eigenmaps *maps, const double *rows, double *ret_signs);

/* Returns FALSE with an error that says that the target is not reached. reached is the relative
 * error of all terms. */
gboolean eigenmaps_missed(const struct eigenmaps_job *job, double reached, GError **error);

/* The two methods of eigenmaps.h. */
gboolean eigenmaps_exact(const struct eigenmaps_job *job, double *ret_error, GError **error);
gboolean eigenmaps_randomised(const struct eigenmaps_job *job, double *ret_error, GError **error);
