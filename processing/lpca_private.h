/* What lpca.c, lpca_cluster.c and lpca_file.c share. */
#pragma once

#include "exr.h"
#include "lpca.h"

/* Calls func for 0 … n − 1, each once, in any thread and order. Results are the same with any
 * number of threads if each writes only what is its own. */
typedef void (*LpcaBlock)(int block, gpointer data);
void lpca_parallel(int n_threads, int n, LpcaBlock func, gpointer data);

/* Rows become orthonormal; length ≥ n. What depends on rows before it becomes 0 with drop, else
 * anything that is orthogonal. */
void lpca_orthonormalise(float *rows, int n, int length, gboolean drop);

/* Rows of a reduced space, and their clusters. */
struct lpca_reduced {
    int n, r;
    const float *rows; /* n × r */
    int n_threads;
    PipelineFunc progress;
    gpointer data;
    GCancellable *cancellable;
    int k, c;           /* asked for; k is lowered to what is of use */
    int *labels;        /* n */
    float *means;       /* k × r */
    float *bases;       /* k × c × r, principal axes in descending order */
    GPtrArray *members; /* k GArrays of int, ascending */
};

/* FALSE when cancelled. Fills labels … members, which lpca_reduced_clear() frees. */
gboolean lpca_cluster(struct lpca_reduced *reduced, GError **error);
void lpca_reduced_clear(struct lpca_reduced *reduced);

/* A file in memory, and what it holds; path is for errors. */
struct exr_file *lpca_to_exr(const struct lpca *lpca);
struct lpca *lpca_from_exr(const struct exr_file *file, const char *path, GError **error);
