#include "work.h"

#include <cblas.h>
#include <gio/gio.h>

#define REPORT_US (G_USEC_PER_SEC / 10)

static const struct work none;

static void report(const struct work *work, const char *stage, int done, int total,
                   gint64 begun_us) {
    const double spent_s = (double)(g_get_monotonic_time() - begun_us) / G_USEC_PER_SEC;
    const struct work_progress now = {stage, done, total,
                                      done > total / 20 ? spent_s / done * (total - done) : -1};
    if (work->progress)
        work->progress(&now, work->data);
}

gboolean work_tell(const struct work *work, const char *stage, int done, int total, gint64 begun_us,
                   GError **error) {
    work = work ? work : &none;
    if (g_cancellable_set_error_if_cancelled(work->cancellable, error))
        return FALSE;
    report(work, stage, done, total, begun_us);
    return TRUE;
}

void work_use_one_blas_thread(void) {
    static GMutex mutex;
    g_mutex_lock(&mutex);
    openblas_set_num_threads(1);
    g_mutex_unlock(&mutex);
}

struct loop {
    WorkBlock func;
    gpointer data;
    GCancellable *cancellable;
    int n, next, done, running;
    GMutex mutex;
    GCond changed;
};

static gpointer take_blocks(gpointer data) {
    struct loop *loop = data;
    work_use_one_blas_thread();
    g_mutex_lock(&loop->mutex);
    while (loop->next < loop->n && !g_cancellable_is_cancelled(loop->cancellable)) {
        const int block = loop->next++;
        g_mutex_unlock(&loop->mutex);
        loop->func(block, loop->data);
        g_mutex_lock(&loop->mutex);
        loop->done++;
    }
    loop->running--;
    g_cond_signal(&loop->changed);
    g_mutex_unlock(&loop->mutex);
    return NULL;
}

gboolean work_parallel(const struct work *work, const char *stage, int n, WorkBlock func,
                       gpointer data, GError **error) {
    work = work ? work : &none;
    const int wanted = work->n_threads > 0 ? work->n_threads : (int)g_get_num_processors();
    struct loop loop = {func, data, work->cancellable, n};
    const int blas_threads = openblas_get_num_threads();
    work_use_one_blas_thread();
    g_mutex_init(&loop.mutex);
    g_cond_init(&loop.changed);
    const int n_threads = loop.running = MIN(wanted, MAX(n, 1));
    g_autofree GThread **threads = g_new(GThread *, n_threads);
    for (int i = 0; i < n_threads; i++)
        threads[i] = g_thread_new("work", take_blocks, &loop);
    /* Reports every REPORT_US until all threads have ended, and at least once. */
    const gint64 begun_us = g_get_monotonic_time();
    int reported = -1;
    g_mutex_lock(&loop.mutex);
    while (loop.running > 0) {
        g_cond_wait_until(&loop.changed, &loop.mutex, g_get_monotonic_time() + REPORT_US);
        const int done = reported = loop.done;
        g_mutex_unlock(&loop.mutex);
        report(work, stage, done, n, begun_us);
        g_mutex_lock(&loop.mutex);
    }
    g_mutex_unlock(&loop.mutex);
    if (reported < 0)
        report(work, stage, loop.done, n, begun_us);
    for (int i = 0; i < n_threads; i++)
        g_thread_join(threads[i]);
    g_mutex_clear(&loop.mutex);
    g_cond_clear(&loop.changed);
    openblas_set_num_threads(blas_threads);
    return !g_cancellable_set_error_if_cancelled(work->cancellable, error);
}

void work_for_each(int n_threads, int n, WorkBlock func, gpointer data) {
    const struct work work = {.n_threads = n_threads};
    work_parallel(&work, "", n, func, data, NULL);
}
