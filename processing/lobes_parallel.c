#include "lobes_private.h"

#include <cblas.h>

#define TELL_US (G_USEC_PER_SEC / 10)

struct parallel {
    LobesBlock func;
    gpointer data;
    GCancellable *cancellable;
    int n, next, done;
    GMutex mutex;
    GCond changed;
    int running;
};

static gpointer take_blocks(gpointer data) {
    struct parallel *parallel = data;
    g_mutex_lock(&parallel->mutex);
    while (parallel->next < parallel->n && !g_cancellable_is_cancelled(parallel->cancellable)) {
        const int block = parallel->next++;
        g_mutex_unlock(&parallel->mutex);
        parallel->func(block, parallel->data);
        g_mutex_lock(&parallel->mutex);
        parallel->done++;
    }
    parallel->running--;
    g_cond_signal(&parallel->changed);
    g_mutex_unlock(&parallel->mutex);
    return NULL;
}

static void tell(const struct lobes_options *options, const char *stage, int done, int n,
                 gint64 begun) {
    const double spent = (double)(g_get_monotonic_time() - begun) / G_USEC_PER_SEC;
    const struct pipeline_progress now = {stage, done, n, done ? spent / done * (n - done) : -1};
    if (options->progress)
        options->progress(&now, options->data);
}

/* Tells what is done until all threads have ended, once at least. */
static void follow(struct parallel *parallel, const struct lobes_options *options,
                   const char *stage) {
    const gint64 begun = g_get_monotonic_time();
    int told = -1;
    g_mutex_lock(&parallel->mutex);
    while (parallel->running > 0) {
        g_cond_wait_until(&parallel->changed, &parallel->mutex, g_get_monotonic_time() + TELL_US);
        const int done = told = parallel->done;
        g_mutex_unlock(&parallel->mutex);
        tell(options, stage, done, parallel->n, begun);
        g_mutex_lock(&parallel->mutex);
    }
    g_mutex_unlock(&parallel->mutex);
    if (told < 0)
        tell(options, stage, parallel->done, parallel->n, begun);
}

gboolean lobes_parallel(const struct lobes_options *options, const char *stage, int n,
                        LobesBlock func, gpointer data, GError **error) {
    const int wanted = options->n_threads > 0 ? options->n_threads : (int)g_get_num_processors();
    struct parallel parallel = {func, data, options->cancellable, n};
    /* Libraries would start threads of their own in each of ours. */
    const int before = openblas_get_num_threads();
    openblas_set_num_threads(1);
    g_mutex_init(&parallel.mutex);
    g_cond_init(&parallel.changed);
    const int n_threads = parallel.running = MIN(wanted, MAX(n, 1));
    g_autofree GThread **threads = g_new(GThread *, n_threads);
    for (int i = 0; i < n_threads; i++)
        threads[i] = g_thread_new("lobes", take_blocks, &parallel);
    follow(&parallel, options, stage);
    for (int i = 0; i < n_threads; i++)
        g_thread_join(threads[i]);
    g_mutex_clear(&parallel.mutex);
    g_cond_clear(&parallel.changed);
    openblas_set_num_threads(before);
    return !g_cancellable_set_error_if_cancelled(options->cancellable, error);
}
