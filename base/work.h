/*
 * Long computations: parallel loops, progress and cancelling, in the same form everywhere.
 *
 * A caller passes a struct work to the computation. The computation reports each stage through it,
 * and stops soon after its cancellable is cancelled. It calls the progress callback only in the
 * thread that has called the computation.
 */
#pragma once

#include <glib.h>

/* <gio/gio.h> declares this type too. It is not included here, because it takes longer to compile
 * than most files that include this header. */
typedef struct _GCancellable GCancellable;

struct work_progress {
    const char *stage; /* "verify", "btf", "mdf", "eigenmaps", "read", … */
    int done, total;
    double left_s; /* remaining time; −1 if it is not known */
};
typedef void (*WorkProgress)(const struct work_progress *progress, gpointer data);

/* The settings of a computation. A NULL pointer to it, or a zeroed struct, means one thread per
 * processor, no reports and no cancelling. */
struct work {
    int n_threads;             /* 0 means one per processor */
    WorkProgress progress;     /* may be NULL */
    gpointer data;             /* passed to progress */
    GCancellable *cancellable; /* may be NULL */
};

/* Reports that `done` of `total` steps are finished. The remaining time is estimated from the time
 * since begun_us (monotonic). The estimate is −1 until more than a twentieth of the steps is done.
 * Returns FALSE with G_IO_ERROR_CANCELLED, and reports nothing, if the computation was
 * cancelled. */
gboolean work_tell(const struct work *work, const char *stage, int done, int total, gint64 begun_us,
                   GError **error);

/* Calls func once for each block from 0 to n − 1, in any thread and order, while the calling thread
 * reports stage. Meanwhile OpenBLAS starts no threads. Returns FALSE with an error if the work was
 * cancelled, after the running calls have ended. If each call writes only its own results, the
 * results do not depend on the number of threads. */
typedef void (*WorkBlock)(int block, gpointer data);
gboolean work_parallel(const struct work *work, const char *stage, int n, WorkBlock func,
                       gpointer data, GError **error);

/* The same as work_parallel(), without reports and cancelling. */
void work_for_each(int n_threads, int n, WorkBlock func, gpointer data);

/* A thread that multiplies matrices in parallel with other threads calls this function first.
 * OpenBLAS with OpenMP keeps a pool of threads for each thread that calls it. Without this call,
 * OpenBLAS would start such a pool for each thread of a parallel loop. */
void work_use_one_blas_thread(void);
