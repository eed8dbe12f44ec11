#include "held_time.h"

#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define MAX_FDS     256
#define MAX_THREADS 4
#define LOOK_NS     20000 /* really: between two looks at threads that work */

/* A thread that is not the main loop's, and what it waits for. */
struct waiter {
    gboolean waits;
    nfds_t n;
    struct pollfd fds[MAX_FDS];
};

static struct disk *timed; /* NULL: poll() is the library's */
static pthread_t main_thread;
static gint64 limit;
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

void held_time_begin(struct disk *disk) {
    main_thread = pthread_self();
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

gboolean __real_g_thread_pool_push(GThreadPool *pool, gpointer data, GError **error);
gboolean __wrap_g_thread_pool_push(GThreadPool *pool, gpointer data, GError **error);
void __real_g_async_queue_push(GAsyncQueue *queue, gpointer data);
void __wrap_g_async_queue_push(GAsyncQueue *queue, gpointer data);

/* Reads a file of /proc without the simulated disk. FALSE: it has gone. */
static gboolean read_proc(const char *thread, const char *name, char *ret, gsize size) {
    char path[96];
    g_snprintf(path, sizeof path, "/proc/self/task/%s/%s", thread, name);
    const int fd = (int)syscall(SYS_open, path, O_RDONLY | O_CLOEXEC);
    const ssize_t n = fd < 0 ? -1 : syscall(SYS_read, fd, ret, size - 1);
    if (fd >= 0)
        syscall(SYS_close, fd);
    ret[MAX(n, 0)] = '\0';
    return n > 0;
}

/* Whether all other threads sleep; a thread that has been woken counts as running. ret: how often
 * they have run. */
static gboolean all_sleep(guint64 *ret_ran) {
    DIR *threads = opendir("/proc/self/task");
    gboolean all = threads != NULL;
    const pid_t self = (pid_t)syscall(SYS_gettid);
    *ret_ran = 0;
    for (const struct dirent *entry; all && (entry = readdir(threads));) {
        char stat[512], runs[96];
        if (*entry->d_name == '.' || atoi(entry->d_name) == self ||
            !read_proc(entry->d_name, "stat", stat, sizeof stat) ||
            !read_proc(entry->d_name, "schedstat", runs, sizeof runs))
            continue;
        const char *name_end = strrchr(stat, ')'), *last = strrchr(runs, ' ');
        all = name_end && name_end[2] == 'S';
        *ret_ran += last ? g_ascii_strtoull(last, NULL, 10) : 0;
    }
    if (threads)
        closedir(threads);
    return all;
}

/* Until all other threads sleep. One may wake another while they are looked at: none must have run
 * between two looks. */
static void wait_for_work(void) {
    guint64 ran, before = 0;
    gboolean slept = FALSE;
    while (timed && pthread_equal(pthread_self(), main_thread)) {
        const gboolean sleep = all_sleep(&ran);
        if (sleep && slept && ran == before)
            return;
        slept = sleep;
        before = ran;
        if (!sleep)
            nanosleep(&(const struct timespec){0, LOOK_NS}, NULL);
    }
}

/* What the main loop gives to a thread of the rig's (the cameras' and those that write frames) is
 * done before the main loop goes on. */
gboolean __wrap_g_thread_pool_push(GThreadPool *pool, gpointer data, GError **error) {
    const gboolean given = __real_g_thread_pool_push(pool, data, error);
    wait_for_work();
    return given;
}

void __wrap_g_async_queue_push(GAsyncQueue *queue, gpointer data) {
    __real_g_async_queue_push(queue, data);
    wait_for_work();
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
