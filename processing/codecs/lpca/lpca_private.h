/* The files lpca*.c share the steps of lpca_compute(), its checkpoint and the file in memory. */
#pragma once

#include "exr/exr.h"
#include "lpca.h"

float *lpca_ones(gsize n); /* g_free() */
struct lpca *lpca_new(const struct btf_matrix *btf, int n_clusters, int n_components);
float *lpca_brdf(const struct lpca *lpca, int cluster, int component); /* component 0 is the mean */

/* Gives all ranks of the team all n values of `size` bytes each. Before the call, a rank has only
 * the values of its own part, which begins at a multiple of `step` (team_part()). Does nothing
 * without a team. */
void lpca_share(const struct team *team, void *values, int n, int step, gsize size);

/* lpca_keep_whole() registers the arrays of a local PCA with the checkpoint under a name. The local
 * PCA must exist until lpca_drop_whole(). lpca_kept_whole() returns a new local PCA with the arrays
 * that an earlier call has saved, but without colours and error. It returns NULL if no arrays of
 * these sizes were saved. */
void lpca_keep_whole(Checkpoint *checkpoint, const char *name, const struct lpca *lpca);
struct lpca *lpca_kept_whole(const Checkpoint *checkpoint, const char *name,
                             const struct btf_matrix *btf, int n_clusters, int n_components);
void lpca_drop_whole(Checkpoint *checkpoint, const char *name);

/* Frees lpca->packed; NULL is ignored. */
void lpca_packed_free(struct lpca_packed *packed);

#define LPCA_BLOCK 1024 /* number of texels that are refined together */

/* Makes the n rows orthonormal; length ≥ n. If drop is TRUE, a row that depends linearly on earlier
 * rows becomes 0. Otherwise, it becomes any unit vector that is orthogonal to the earlier rows. */
void lpca_orthonormalise(float *rows, int n, int length, gboolean drop);

struct lpca_run;

/* Rows of a reduced space, and their clusters. */
struct lpca_reduced {
    int n, r;
    const float *rows;                  /* n × r */
    const struct lpca_options *options; /* gives threads, progress, cancellable and team */
    struct lpca_run *run; /* the run whose checkpoint saves the state of the clustering, or NULL */
    /* k  requested number of clusters, which lpca_cluster() lowers to the number of clusters that
     *    have rows
     * c  number of components */
    int k, c;
    int *labels;  /* n: cluster of each row */
    float *means; /* k × r: mean of each cluster */
    /* k × c × r: principal axes in descending order of variance */
    float *bases;
    GPtrArray *members; /* k GArrays of int in ascending order */
};

/* Clusters the rows. Fills labels … members, which lpca_reduced_clear() frees. Returns FALSE when
 * cancelled. */
gboolean lpca_cluster(struct lpca_reduced *reduced, GError **error);
void lpca_reduced_clear(struct lpca_reduced *reduced);
/* Computes the coordinates of the rows `from` … `end` − 1 in their clusters. Row x of weights (n ×
 * c) becomes A_k (r_x − m_k) with the axes A_k (c × r) and the mean m_k of k = labels[x]. */
void lpca_reduced_weights(const struct lpca_reduced *reduced, const int *labels, int from, int end,
                          float *weights);

/* The stage of lpca_compute(). The content of its checkpoint depends on the stage. */
enum lpca_stage {
    LPCA_BEGUN,
    LPCA_REDUCING, /* some blocks of rows are done */
    LPCA_REDUCED,
    LPCA_CLUSTERING, /* the checkpoint is between two iterations */
    LPCA_REFINING,   /* clusters are found; some views are done */
    LPCA_WEIGHING,   /* eigen-BRDFs are done; some blocks of weights are done */
    LPCA_MADE,
};

/* The state of lpca_compute() as it is stored in the checkpoint, byte by byte. */
struct lpca_state {
    gint32 form, n_clusters, n_components, colours, to_pack; /* arguments of the call */
    gint32 stage;                                            /* enum lpca_stage */
    gint32 c, k;      /* c: present number of components; k: number of clusters that are left */
    gint32 iteration; /* number of the next iteration of clustering */
    /* few     the largest number of components known to miss the target; 0 if none is known
     * enough  the smallest number known to reach the target; 0 if none is known */
    gint32 few, enough;
    gint32 unused;       /* padding, so that the doubles are aligned */
    double target;       /* argument of the call */
    double before;       /* sum of squared errors of the last iteration */
    double error;        /* lpca_error() of the result so far; −1 if not known */
    double enough_error; /* lpca_error() with `enough` components */
};

/* The arrays that a checkpoint may have, for n texels of d values, r reduced dimensions, c
 * components and k clusters. */
enum lpca_kept {
    LPCA_KEPT_MEAN,    /* d */
    LPCA_KEPT_AXES,    /* r × d */
    LPCA_KEPT_ROWS,    /* n × r */
    LPCA_KEPT_LABELS,  /* n */
    LPCA_KEPT_MEANS,   /* means of a reduced space: requested number of clusters × r */
    LPCA_KEPT_BASES,   /* axes of a reduced space: requested number of clusters × c × r */
    LPCA_KEPT_BRDFS,   /* eigen-BRDFs of k clusters */
    LPCA_KEPT_WEIGHTS, /* n × c */
    LPCA_KEPT_SQUARES, /* sums of squares, k doubles for each view */
    LPCA_KEPT_KINDS
};

/* All data of lpca_compute(). A rank of a team has the reduced rows of all texels, but the BTF's
 * values only of texels first … end − 1. */
struct lpca_run {
    const struct btf_matrix *btf;
    const struct lpca_options *options;
    /* n        number of texels
     * d        number of values of a texel
     * columns  number of values of a texel in one view */
    int n, d, columns;
    int first, end;
    float *mean; /* d: mean of the sample, which is subtracted from the texels' values */
    int r;
    float *axes;    /* r × d: axes of the reduced space */
    float *offsets; /* r: products of axes and mean */
    float *rows;    /* n × r: products of axes and values minus the mean */
    GMutex lock;    /* protects `failed` */
    GError *failed; /* the first error of any thread */
    struct lpca_state state;
    /* 1 for each block of the stage that is done, otherwise 0; NULL without a checkpoint */
    int *done;
};

/* The functions of lpca_checkpoint.c do nothing if options->checkpoint is NULL. lpca_resume() sets
 * run->state to the state that a call with the same arguments saved. If there is no such state,
 * lpca_resume() sets run->state to the state of a new computation. */
void lpca_resume(struct lpca_run *run);
/* Drops all arrays from the checkpoint. Arrays that were given to lpca_keep() may be freed
 * afterwards. */
void lpca_leave(struct lpca_run *run);
/* Begins a stage, and drops the arrays from the checkpoint that the stage does not need. */
void lpca_enter(struct lpca_run *run, enum lpca_stage stage);
/* Registers an array with the checkpoint. Its size follows from run->state. If an earlier call has
 * saved the array, its values are copied to `values` first. */
void lpca_keep(struct lpca_run *run, enum lpca_kept what, gpointer values);
/* Registers the flags of the stage's n blocks, run->done, with the checkpoint, and restores flags
 * that an earlier call has saved. lpca_run_blocks() skips blocks that are done. */
void lpca_keep_blocks(struct lpca_run *run, int n);
void lpca_drop_blocks(struct lpca_run *run);

/* Reads rows as btf_matrix_rows() does, in the colours of the options. texel counts from the BTF's
 * first texel. If rows cannot be read, they are 0, and run->failed is set. buffer has n ×
 * columns. */
const float *lpca_run_rows(struct lpca_run *run, int view, int texel, int n, float *buffer,
                           gsize *ret_stride);

/* Reads rows as btf_matrix_place_rows() does, in the colours of the options. If rows cannot be
 * read, they are 0, and run->failed is set. */
void lpca_run_place_rows(struct lpca_run *run, int view, int texel, int n, const int *indices,
                         float *ret);

/* Runs a stage of n blocks in all threads. Returns FALSE if it was cancelled or failed; the
 * checkpoint is then saved. */
gboolean lpca_run_blocks(struct lpca_run *run, const char *stage, int n, WorkBlock func,
                         gpointer data, GError **error);

/* Makes a local PCA in all dimensions from a clustering in few dimensions. Computes the eigen-BRDFs
 * E_k = orth(X_kᵀ P_k) from the rows X_k of cluster k and their coordinates P_k in few dimensions,
 * then the weights of all texels. The member `error` of the result is the error in the colours of
 * the options, or −1 if lpca_run_error() must compute it. */
struct lpca *lpca_refine(struct lpca_run *run, const struct lpca_reduced *reduced, GError **error);

/* Sets lpca->error as lpca_error() does, for the texels and the team of the run. Returns FALSE with
 * an error if values cannot be read or the work is cancelled. */
gboolean lpca_run_error(struct lpca_run *run, struct lpca *lpca, GError **error);

/* Convert between a local PCA and its file in memory. path is for errors. */
struct exr_file *lpca_to_exr(const struct lpca *lpca);
struct lpca *lpca_from_exr(const struct exr_file *file, const char *path, GError **error);
