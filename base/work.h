/*
 * Long computations: parallel loops, progress and cancelling, the same in every room.
 *
 * A caller hands a struct work down; the computation reports each stage through it and stops soon
 * after its cancellable is cancelled. All callbacks come from the calling thread.
 */
#pragma once

#include <gio/gio.h>

struct work_progress {
    const char *stage; /* "verify", "btf", "mdf", "eigenmaps", "read", … */
    int done, total;
    double left_s; /* −1: not known */
};
typedef void (*WorkProgress)(const struct work_progress *progress, gpointer data);

/* NULL, or all zero: one thread per processor, no reports, no cancelling. */
struct work {
    int n_threads;             /* 0: one per processor */
    WorkProgress progress;     /* may be NULL; called from the calling thread */
    gpointer data;             /* of progress */
    GCancellable *cancellable; /* may be NULL */
};

/* Reports done of total; the time left follows from what has been spent since begun_us (monotonic)
 * and is −1 before a twentieth is done. FALSE with G_IO_ERROR_CANCELLED when cancelled. */
gboolean work_tell(const struct work *work, const char *stage, int done, int total, gint64 begun_us,
                   GError **error);

/* Calls func for 0 … n − 1, each once, in any thread and order, while the calling thread reports
 * stage. Libraries start no threads of their own meanwhile. FALSE when cancelled, after the calls
 * under way have ended. If each call writes only its own results, these are the same with any
 * number of threads. */
typedef void (*WorkBlock)(int block, gpointer data);
gboolean work_parallel(const struct work *work, const char *stage, int n, WorkBlock func,
                       gpointer data, GError **error);

/* The same without reports and cancelling. */
void work_for_each(int n_threads, int n, WorkBlock func, gpointer data);

/* A thread that multiplies matrices beside others calls this first: OpenBLAS on OpenMP keeps a
 * number of threads for each thread that calls it, and would start that many in each of ours. */
void work_use_one_blas_thread(void);
