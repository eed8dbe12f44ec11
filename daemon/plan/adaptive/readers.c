#include "readers.h"

#define N_READERS 2

struct readers_job {
    ReadersRead read;
    GDestroyNotify drop;
    gpointer job;
    char *frame;
    GError *error; /* error of a job that has failed; NULL otherwise */
};

struct Readers {
    Clock *clock;
    GThreadPool *pool;
    GMutex mutex;
    GCond idle;
    int n_reading;     /* number of jobs that have not ended; guarded by mutex */
    GPtrArray *failed; /* of struct readers_job: jobs that have failed; guarded by mutex */
    int stopped;       /* atomic */
};

static void free_job(gpointer data) {
    struct readers_job *job = data;
    job->drop(job->job);
    g_clear_error(&job->error);
    g_free(job->frame);
    g_free(job);
}

/* Runs a job in a thread of the pool. */
static void run(gpointer data, gpointer readers_data) {
    struct readers_job *job = data;
    Readers *readers = readers_data;
    const gboolean good = readers_stopped(readers) || job->read(job->job, &job->error);
    if (good)
        free_job(job);
    g_mutex_lock(&readers->mutex);
    if (!good)
        g_ptr_array_add(readers->failed, job);
    if (--readers->n_reading == 0)
        g_cond_broadcast(&readers->idle);
    g_mutex_unlock(&readers->mutex);
}

Readers *readers_new(Clock *clock) {
    Readers *readers = g_new0(Readers, 1);
    readers->clock = clock;
    g_mutex_init(&readers->mutex);
    g_cond_init(&readers->idle);
    readers->failed = g_ptr_array_new_with_free_func(free_job);
    readers->pool = g_thread_pool_new(run, readers, N_READERS, FALSE, NULL);
    return readers;
}

static void wait_until_idle(Readers *readers) {
    while (readers->n_reading > 0)
        g_cond_wait(&readers->idle, &readers->mutex);
}

static void begin(Readers *readers, struct readers_job *job) {
    g_mutex_lock(&readers->mutex);
    readers->n_reading++;
    g_thread_pool_push(readers->pool, job, NULL);
    if (clock_is_lockstep(readers->clock))
        wait_until_idle(readers);
    g_mutex_unlock(&readers->mutex);
}

void readers_push(Readers *readers, ReadersRead read, GDestroyNotify drop, gpointer data,
                  const char *frame) {
    struct readers_job *job = g_new(struct readers_job, 1);
    *job = (struct readers_job){.read = read, .drop = drop, .job = data, .frame = g_strdup(frame)};
    begin(readers, job);
}

gboolean readers_wait(Readers *readers, GError **error) {
    GError *found = NULL;
    g_mutex_lock(&readers->mutex);
    wait_until_idle(readers);
    if (readers->failed->len > 0)
        found = g_error_copy(((const struct readers_job *)readers->failed->pdata[0])->error);
    g_mutex_unlock(&readers->mutex);
    if (!found)
        return TRUE;
    g_propagate_error(error, found);
    return FALSE;
}

void readers_retry(Readers *readers) {
    g_mutex_lock(&readers->mutex);
    wait_until_idle(readers);
    g_autoptr(GPtrArray) failed = g_steal_pointer(&readers->failed);
    readers->failed = g_ptr_array_new_with_free_func(free_job);
    g_mutex_unlock(&readers->mutex);
    while (failed->len > 0) {
        struct readers_job *job = g_ptr_array_steal_index(failed, 0);
        g_clear_error(&job->error);
        begin(readers, job);
    }
}

void readers_each_failed(Readers *readers,
                         void (*each)(const char *frame, const GError *error, gpointer data),
                         gpointer data) {
    for (guint i = 0; i < readers->failed->len; i++) {
        const struct readers_job *job = readers->failed->pdata[i];
        each(job->frame, job->error, data);
    }
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
    g_ptr_array_unref(readers->failed);
    g_mutex_clear(&readers->mutex);
    g_cond_clear(&readers->idle);
    g_free(readers);
}
