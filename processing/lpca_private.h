/* What lpca*.c share. */
#pragma once

#include "exr.h"
#include "lpca.h"

int lpca_dimensions(int n_views, int n_lights);
struct lpca *lpca_new(const struct btf_matrix *btf, int n_clusters, int n_components);
float *lpca_brdf(const struct lpca *lpca, int cluster, int component); /* 0: the mean */

/* A thread that multiplies beside others: OpenBLAS on OpenMP keeps a number of threads for each
 * thread that calls it, and would start a team in each of ours. */
void lpca_use_one_thread(void);

/* Calls func for 0 … n − 1, each once, in any thread and order. Results are the same with any
 * number of threads if each writes only what is its own. */
typedef void (*LpcaBlock)(int block, gpointer data);
void lpca_parallel(int n_threads, int n, LpcaBlock func, gpointer data);

/* Of lpca->packed; NULL is ignored. */
void lpca_packed_free(struct lpca_packed *packed);

#define LPCA_BLOCK 1024 /* texels polished at a time */

/* Rows become orthonormal; length ≥ n. What depends on rows before it becomes 0 with drop, else
 * anything that is orthogonal. */
void lpca_orthonormalise(float *rows, int n, int length, gboolean drop);

/* Rows of a reduced space, and their clusters. */
struct lpca_reduced {
    int n, r;
    const float *rows;                  /* n × r */
    const struct lpca_options *options; /* threads, progress, cancellable, team */
    int k, c;                           /* asked for; k is lowered to what is of use */
    int *labels;                        /* n */
    float *means;                       /* k × r */
    float *bases;                       /* k × c × r, principal axes in descending order */
    GPtrArray *members;                 /* k GArrays of int, ascending */
};

/* FALSE when cancelled. Fills labels … members, which lpca_reduced_clear() frees. */
gboolean lpca_cluster(struct lpca_reduced *reduced, GError **error);
void lpca_reduced_clear(struct lpca_reduced *reduced);

/* Everything lpca_compute() holds. Ranks of a team have rows of all texels, but the BTF's values
 * of first … end − 1 alone. */
struct lpca_run {
    const struct btf_matrix *btf;
    const struct lpca_options *options;
    int n, d, columns; /* texels, values of each, those of a view */
    int first, end;
    float *mean; /* d: about which rows are taken */
    int r;
    float *axes;    /* r × d */
    float *offsets; /* r: products of axes and mean */
    float *rows;    /* n × r: products of values less mean with axes */
    GMutex lock;
    GError *failed; /* the first error of any thread */
};

/* As btf_matrix_rows(), in the colours of the options; texel counts from the BTF's first. Of what
 * cannot be read 0, and run->failed. buffer: n × columns. */
const float *lpca_run_rows(struct lpca_run *run, int view, int texel, int n, float *buffer,
                           gsize *ret_stride);

/* The same as btf_matrix_place_rows(). */
void lpca_run_place_rows(struct lpca_run *run, int view, int texel, int n, const int *places,
                         float *ret);

/* A stage of n blocks in all threads: FALSE if it was cancelled or failed. */
gboolean lpca_run_blocks(struct lpca_run *run, const char *stage, int n, LpcaBlock func,
                         gpointer data, GError **error);

/* From a clustering in few dimensions to one in all: E_k = orth(X_kᵀ W_k), then the weights of all
 * texels and the error in the colours of the options; −1: to be found by lpca_run_error(). */
struct lpca *lpca_polish(struct lpca_run *run, const struct lpca_reduced *reduced, GError **error);

/* lpca_error() of the run's texels and team. */
gboolean lpca_run_error(struct lpca_run *run, struct lpca *lpca, GError **error);

/* A file in memory, and what it holds; path is for errors. */
struct exr_file *lpca_to_exr(const struct lpca *lpca);
struct lpca *lpca_from_exr(const struct exr_file *file, const char *path, GError **error);
