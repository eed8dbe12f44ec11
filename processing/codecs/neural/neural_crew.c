#include "neural_private.h"

struct neural_crew {
    int n_threads; /* number of threads besides the calling thread */
    GThread **threads;
    GMutex mutex;
    GCond begun, ended;
    guint loop;   /* number of loops that were begun */
    int working;  /* number of threads that have not ended the loop */
    gboolean end; /* whether the threads must end */
    /* n: number of blocks of the loop
     * next: next block to take (atomic) */
    int n, next;
    WorkBlock func;
    gpointer data;
};

static void take_blocks(struct neural_crew *crew) {
    for (;;) {
        const int block = g_atomic_int_add(&crew->next, 1);
        if (block >= crew->n)
            return;
        crew->func(block, crew->data);
    }
}

static gpointer work_in_thread(gpointer data) {
    struct neural_crew *crew = data;
    guint seen = 0;
    g_mutex_lock(&crew->mutex);
    for (;;) {
        while (crew->loop == seen && !crew->end)
            g_cond_wait(&crew->begun, &crew->mutex);
        if (crew->end)
            break;
        seen = crew->loop;
        g_mutex_unlock(&crew->mutex);
        take_blocks(crew);
        g_mutex_lock(&crew->mutex);
        if (--crew->working == 0)
            g_cond_signal(&crew->ended);
    }
    g_mutex_unlock(&crew->mutex);
    return NULL;
}

struct neural_crew *neural_crew_new(int n_threads) {
    struct neural_crew *crew = g_new0(struct neural_crew, 1);
    g_mutex_init(&crew->mutex);
    g_cond_init(&crew->begun);
    g_cond_init(&crew->ended);
    crew->n_threads = (n_threads > 0 ? n_threads : (int)g_get_num_processors()) - 1;
    crew->threads = g_new0(GThread *, crew->n_threads + 1);
    for (int i = 0; i < crew->n_threads; i++)
        crew->threads[i] = g_thread_new("neural", work_in_thread, crew);
    return crew;
}

void neural_crew_free(struct neural_crew *crew) {
    g_mutex_lock(&crew->mutex);
    crew->end = TRUE;
    g_cond_broadcast(&crew->begun);
    g_mutex_unlock(&crew->mutex);
    for (int i = 0; i < crew->n_threads; i++)
        g_thread_join(crew->threads[i]);
    g_mutex_clear(&crew->mutex);
    g_cond_clear(&crew->begun);
    g_cond_clear(&crew->ended);
    g_free(crew->threads);
    g_free(crew);
}

void neural_crew_run(struct neural_crew *crew, int n, WorkBlock func, gpointer data) {
    g_mutex_lock(&crew->mutex);
    crew->n = n;
    crew->func = func;
    crew->data = data;
    crew->working = crew->n_threads;
    g_atomic_int_set(&crew->next, 0);
    crew->loop++;
    g_cond_broadcast(&crew->begun);
    g_mutex_unlock(&crew->mutex);
    take_blocks(crew);
    g_mutex_lock(&crew->mutex);
    while (crew->working > 0)
        g_cond_wait(&crew->ended, &crew->mutex);
    g_mutex_unlock(&crew->mutex);
}
