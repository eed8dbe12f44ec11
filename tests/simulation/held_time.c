#include "held_time.h"

#include <dlfcn.h>
#include <poll.h>
#include <pthread.h>
#include <string.h>
#include <sys/prctl.h>

#define MAX_FDS     256
#define MAX_THREADS 4
#define WORK_MS     1000 /* really: how long the main loop sleeps while a thread works */

/* A thread that is not the main loop's, and what it waits for. */
struct waiter {
    gboolean waits;
    nfds_t n;
    struct pollfd fds[MAX_FDS];
};

static struct disk *timed; /* NULL: poll() is the library's */
static const gboolean *idle_hold;
static pthread_t main_thread;
static gint64 limit;
static gint holds; /* atomic: of the rig's clock */
static void (*feed)(gpointer data);
static gpointer feed_data;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static struct waiter waiters[MAX_THREADS];
static int n_waiters;
static guint n_changes;
static gboolean has_bus, knows_bus; /* there is a thread of GDBus; it has come here */
static __thread struct waiter *own;

static int real_poll(struct pollfd *fds, nfds_t n, int timeout_ms) {
    typedef int (*Poll)(struct pollfd *, nfds_t, int);
    static Poll real;
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "poll");
    return real(fds, n, timeout_ms);
}

void held_time_begin(struct disk *disk, const gboolean *is_idle) {
    main_thread = pthread_self();
    idle_hold = is_idle;
    limit = disk->ended_us;
    timed = disk;
}

void held_time_set_limit(gint64 limit_us) {
    limit = limit_us;
}

void held_time_set_feeder(void (*func)(gpointer data), gpointer data) {
    feed = func;
    feed_data = data;
}

void __real_clock_hold(Clock *clock);
void __wrap_clock_hold(Clock *clock);
void __real_clock_release(Clock *clock);
void __wrap_clock_release(Clock *clock);

void __wrap_clock_hold(Clock *clock) {
    g_atomic_int_inc(&holds);
    __real_clock_hold(clock);
}

void __wrap_clock_release(Clock *clock) {
    g_atomic_int_add(&holds, -1);
    __real_clock_release(clock);
}

gboolean held_time_is_held(void) {
    return g_atomic_int_get(&holds) > (*idle_hold ? 1 : 0);
}

/* With the lock. */
static gboolean all_wait(void) {
    if (has_bus && !knows_bus)
        return FALSE;
    for (int i = 0; i < n_waiters; i++) {
        struct pollfd fds[MAX_FDS];
        if (!waiters[i].waits)
            return FALSE;
        memcpy(fds, waiters[i].fds, waiters[i].n * sizeof *fds);
        if (real_poll(fds, waiters[i].n, 0) > 0)
            return FALSE;
    }
    return TRUE;
}

void held_time_set_bus(void) {
    has_bus = TRUE;
}

void held_time_wait(void) {
    pthread_mutex_lock(&lock);
    while (!all_wait()) {
        const guint before = n_changes;
        while (n_changes == before)
            pthread_cond_wait(&changed, &lock);
    }
    pthread_mutex_unlock(&lock);
}

/* A thread that looks without waiting has something else to do. */
static int poll_beside(struct pollfd *fds, nfds_t n, int timeout_ms) {
    if (n > MAX_FDS)
        g_error("simulate: a thread waits for %d descriptors", (int)n);
    pthread_mutex_lock(&lock);
    if (!own && n_waiters == MAX_THREADS)
        g_error("simulate: more than %d threads wait for descriptors", MAX_THREADS);
    if (!own) {
        char name[16] = "";
        prctl(PR_GET_NAME, name);
        knows_bus |= strcmp(name, "gdbus") == 0;
        own = &waiters[n_waiters++];
    }
    own->n = n;
    memcpy(own->fds, fds, n * sizeof *fds);
    own->waits = timeout_ms != 0;
    n_changes++;
    pthread_cond_signal(&changed);
    pthread_mutex_unlock(&lock);
    const int ready = real_poll(fds, n, timeout_ms);
    pthread_mutex_lock(&lock);
    own->waits = FALSE;
    pthread_mutex_unlock(&lock);
    return ready;
}

static int poll_main(struct pollfd *fds, nfds_t n, int timeout_ms) {
    held_time_wait();
    int ready = real_poll(fds, n, 0);
    if (ready == 0 && timeout_ms != 0 && feed) {
        feed(feed_data);
        ready = real_poll(fds, n, 0);
    }
    if (ready != 0 || timeout_ms == 0)
        return ready;
    if (held_time_is_held())
        return real_poll(fds, n, WORK_MS);
    const gint64 left_us = MAX(limit - timed->ended_us, 0);
    timed->ended_us += timeout_ms < 0 ? left_us : MIN((gint64)timeout_ms * 1000, left_us);
    return 0;
}

int poll(struct pollfd *fds, nfds_t n, int timeout_ms) {
    if (!timed)
        return real_poll(fds, n, timeout_ms);
    return pthread_equal(pthread_self(), main_thread) ? poll_main(fds, n, timeout_ms)
                                                      : poll_beside(fds, n, timeout_ms);
}
