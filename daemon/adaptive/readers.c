#include "readers.h"

#define N_READERS 2

struct readers_job {
    ReadersRead read;
    GDestroyNotify drop;
    gpointer job;
};

struct Readers {
    Clock *clock;
    GThreadPool *pool;
    GMutex mutex;
    GCond idle;
    int n_reading; /* guarded by mutex */
    GError *error; /* the first; guarded by mutex */
    int stopped;   /* atomic */
};

/* A reader's thread. */
static void readers_run(gpointer data, gpointer readers_data) {
    struct readers_job *job = data;
    Readers *readers = readers_data;
    g_autoptr(GError) error = NULL;
    if (!readers_stopped(readers))
        job->read(job->job, &error);
    job->drop(job->job);
    g_free(job);
    g_mutex_lock(&readers->mutex);
    if (error && !readers->error)
        readers->error = g_steal_pointer(&error);
    if (--readers->n_reading == 0)
        g_cond_broadcast(&readers->idle);
    g_mutex_unlock(&readers->mutex);
}

Readers *readers_new(Clock *clock) {
    Readers *readers = g_new0(Readers, 1);
    readers->clock = clock;
    g_mutex_init(&readers->mutex);
    g_cond_init(&readers->idle);
    readers->pool = g_thread_pool_new(readers_run, readers, N_READERS, FALSE, NULL);
    return readers;
}

static void readers_wait_until_idle(Readers *readers) {
    while (readers->n_reading > 0)
        g_cond_wait(&readers->idle, &readers->mutex);
}

void readers_push(Readers *readers, ReadersRead read, GDestroyNotify drop, gpointer data) {
    struct readers_job *job = g_new(struct readers_job, 1);
    *job = (struct readers_job){read, drop, data};
    g_mutex_lock(&readers->mutex);
    readers->n_reading++;
    g_thread_pool_push(readers->pool, job, NULL);
    if (clock_is_lockstep(readers->clock))
        readers_wait_until_idle(readers);
    g_mutex_unlock(&readers->mutex);
}

gboolean readers_wait(Readers *readers, GError **error) {
    g_mutex_lock(&readers->mutex);
    readers_wait_until_idle(readers);
    GError *found = g_steal_pointer(&readers->error);
    g_mutex_unlock(&readers->mutex);
    if (!found)
        return TRUE;
    g_propagate_error(error, found);
    return FALSE;
}

gboolean readers_stopped(const Readers *readers) {
    return g_atomic_int_get(&readers->stopped);
}

void readers_stop(Readers *readers) {
    g_atomic_int_set(&readers->stopped, TRUE);
}

void readers_free(Readers *readers) {
    if (!readers)
        return;
    readers_stop(readers);
    g_thread_pool_free(readers->pool, FALSE, TRUE);
    g_clear_error(&readers->error);
    g_mutex_clear(&readers->mutex);
    g_cond_clear(&readers->idle);
    g_free(readers);
}
