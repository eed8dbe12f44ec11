#include "lock.h"

#include "device.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#define PREFIX    "mesorig "
#define RESCUE    " rescue"            /* suffix of the key while a program makes the device safe */
#define RESCUE_US (5 * G_USEC_PER_SEC) /* longest time that an owner waits for such a program */
#define LOOK_US   20000
/* time between two calls of on_drain(); up to SOMAXCONN processes may connect meanwhile */
#define DRAIN_S     10
#define MAX_COMMAND 120 /* largest number of bytes of a command line that are shown */

struct Lock {
    char *key;
    int fd;         /* −1 if no lock is held */
    GSource *drain; /* calls on_drain() every DRAIN_S seconds */
};

static gint role = LOCK_OWNER; /* atomic */
static gint found;             /* atomic; the result of lock_steal_found() */

/* Held while a socket is closed, and while on_drain() accepts connections from it. The main loop
 * therefore never accepts from a descriptor that another thread has closed. */
static GMutex drain_mutex;

void lock_set_role(enum lock_role wanted) {
    g_atomic_int_set(&role, (gint)wanted);
}

enum lock_role lock_get_role(void) {
    return (enum lock_role)g_atomic_int_get(&role);
}

pid_t lock_steal_found(void) {
    const gint pid = g_atomic_int_get(&found);
    g_atomic_int_set(&found, 0);
    return pid;
}

/* Fills in the address of a key. A key that does not fit is replaced by its SHA-256 sum. Returns
 * the length of the address. */
static socklen_t set_address(const char *key, struct sockaddr_un *ret) {
    *ret = (struct sockaddr_un){.sun_family = AF_UNIX};
    char *name = ret->sun_path + 1; /* after the zero that makes it abstract */
    const gsize room = sizeof ret->sun_path - 1;
    gsize n = (gsize)g_snprintf(name, room, PREFIX "%s", key);
    if (n >= room) {
        g_autofree char *sum = g_compute_checksum_for_string(G_CHECKSUM_SHA256, key, -1);
        n = (gsize)g_snprintf(name, room, PREFIX "%s", sum);
    }
    return (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + n);
}

/* Accepts and closes the connections of processes that have asked for the holder of the lock. A
 * timer calls this function, because a source that waits for connections would make the main loop
 * spin while this process has no descriptor left to accept them. */
static gboolean on_drain(gpointer data) {
    const int fd = GPOINTER_TO_INT(data);
    g_mutex_lock(&drain_mutex);
    for (int asked = 0; asked >= 0 && !g_source_is_destroyed(g_main_current_source());) {
        asked = accept4(fd, NULL, NULL, SOCK_CLOEXEC);
        if (asked >= 0)
            close(asked);
    }
    g_mutex_unlock(&drain_mutex);
    return G_SOURCE_CONTINUE;
}

/* Makes the listening socket of a lock. Returns 0, or errno on failure. EADDRINUSE means that
 * the lock is held, by this process or another one. */
static int hold(Lock *lock) {
    struct sockaddr_un address;
    const socklen_t length = set_address(lock->key, &address);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return errno;
    if (bind(fd, (struct sockaddr *)&address, length) < 0 || listen(fd, SOMAXCONN) < 0) {
        const int why = errno;
        close(fd);
        return why;
    }
    lock->fd = fd;
    lock->drain = g_timeout_source_new_seconds(DRAIN_S);
    g_source_set_callback(lock->drain, on_drain, GINT_TO_POINTER(fd), NULL);
    g_source_attach(lock->drain, NULL);
    return 0;
}

static void let_go(Lock *lock) {
    if (lock->fd < 0)
        return;
    g_mutex_lock(&drain_mutex);
    g_source_destroy(lock->drain);
    close(lock->fd);
    g_mutex_unlock(&drain_mutex);
    g_source_unref(lock->drain);
    lock->fd = -1;
}

gboolean lock_holder(const char *key, pid_t *ret_pid) {
    struct sockaddr_un address;
    const socklen_t length = set_address(key, &address);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    struct ucred holder = {0};
    socklen_t size = sizeof holder;
    *ret_pid = 0;
    if (fd < 0)
        return FALSE;
    const int why = connect(fd, (struct sockaddr *)&address, length) < 0 ? errno : 0;
    if (why == 0 && getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &holder, &size) == 0)
        *ret_pid = holder.pid;
    close(fd);
    /* EAGAIN: many processes have asked a holder that is stopped. */
    return why == 0 || why == EAGAIN;
}

static char *read_command(pid_t pid, gsize *ret_length) {
    g_autofree char *path = g_strdup_printf("/proc/%d/cmdline", (int)pid);
    char *command = NULL;
    return pid > 0 && g_file_get_contents(path, &command, ret_length, NULL) ? command : NULL;
}

char *lock_process(pid_t pid) {
    gsize n = 0;
    g_autofree char *command = read_command(pid, &n);
    if (!command || n == 0)
        return pid > 0 ? g_strdup_printf("process %d", (int)pid) : g_strdup("another program");
    g_autofree char *program = g_path_get_basename(command);
    GString *text = g_string_new(program);
    for (gsize i = strlen(command) + 1; i < n; i += strlen(command + i) + 1)
        g_string_append_printf(text, " %s", command + i);
    g_autofree char *whole = g_utf8_make_valid(text->str, -1);
    g_string_assign(text, whole);
    if (text->len > MAX_COMMAND) {
        g_string_truncate(
            text, (gsize)(g_utf8_find_prev_char(text->str, text->str + MAX_COMMAND) - text->str));
        g_string_append(text, "…");
    }
    g_string_append_printf(text, " (process %d)", (int)pid);
    return g_string_free(text, FALSE);
}

gboolean lock_is_daemon(pid_t pid) {
    gsize n = 0;
    g_autofree char *command = read_command(pid, &n);
    if (!command || n == 0)
        return FALSE;
    g_autofree char *program = g_path_get_basename(command);
    gboolean rescues = FALSE;
    for (gsize i = strlen(command) + 1; i < n; i += strlen(command + i) + 1)
        rescues |= g_str_has_prefix(command + i, "--safe-state") ||
                   g_str_has_prefix(command + i, "--guardian");
    return strcmp(program, "mesorigd") == 0 && !rescues;
}

static gboolean refuse(const char *what, pid_t pid, GError **error) {
    g_autofree char *holder = lock_process(pid);
    if (pid == getpid())
        return device_error_set(
            error, DEVICE_ERROR_BUSY, NULL,
            "%s is already open for another section of the rig file" ERROR_ADVICE
            "write a shared line or board the same way in both sections, or correct one of them",
            what);
    return device_error_set(
        error, DEVICE_ERROR_BUSY, NULL, "cannot open %s: %s uses it" ERROR_ADVICE "%s", what,
        holder,
        lock_is_daemon(pid)
            ? "use that daemon instead (commands find it by --address or --bus), or end it"
            : "end that program");
}

/* Takes the lock of an owner. No other process may hold it, and no process may be making the device
 * safe. */
static gboolean take_for_owner(Lock *lock, enum lock_kind kind, const char *what, GError **error) {
    g_autofree char *rescue = g_strconcat(lock->key, RESCUE, NULL);
    const gint64 until = g_get_monotonic_time() + RESCUE_US;
    pid_t pid = 0;
    const int why = hold(lock);
    if (why == EADDRINUSE) {
        lock_holder(lock->key, &pid);
        g_atomic_int_set(&found, (gint)pid);
        return refuse(what, pid, error);
    }
    if (why)
        return device_error_set(error, DEVICE_ERROR_BUSY, NULL,
                                "cannot lock %s for this program: %s" ERROR_ADVICE
                                "if this program runs as a service or in a container, allow it "
                                "AF_UNIX sockets and more open files",
                                what, g_strerror(why));
    while (kind == LOCK_ALONE && lock_holder(rescue, &pid)) {
        if (g_get_monotonic_time() > until)
            return refuse(what, pid, error);
        g_usleep(LOOK_US);
    }
    return TRUE;
}

/* Takes the lock of a program that makes the device safe. Such a program announces itself first,
 * and then looks for an owner. An owner takes its own lock first, and then looks for such a
 * program. If both come at the same time, at least one therefore sees the other. If no socket can
 * be made, the program continues, because a missing socket must not keep a laser on. */
static gboolean take_for_rescue(Lock *lock, enum lock_kind kind, const char *what, GError **error) {
    pid_t pid = 0;
    g_autofree char *key = g_steal_pointer(&lock->key);
    lock->key = g_strconcat(key, RESCUE, NULL);
    if (kind == LOCK_ALONE && hold(lock) == EADDRINUSE) {
        lock_holder(lock->key, &pid);
        return refuse(what, pid, error);
    }
    if (!lock_holder(key, &pid))
        return TRUE;
    g_atomic_int_set(&found, (gint)pid);
    return (kind == LOCK_SHARED && lock_get_role() == LOCK_OPERATOR) || refuse(what, pid, error);
}

Lock *lock_take(const char *key, enum lock_kind kind, const char *what, GError **error) {
    Lock *lock = g_new0(Lock, 1);
    lock->key = g_strdup(key);
    lock->fd = -1;
    const gboolean taken = lock_get_role() == LOCK_OWNER ? take_for_owner(lock, kind, what, error)
                                                         : take_for_rescue(lock, kind, what, error);
    if (taken) {
        g_free(lock->key);
        lock->key = g_strdup(key);
        return lock;
    }
    lock_release(lock);
    return NULL;
}

void lock_release(Lock *lock) {
    if (!lock)
        return;
    let_go(lock);
    g_free(lock->key);
    g_free(lock);
}

const char *lock_key(const Lock *lock) {
    return lock->key;
}

char *lock_key_of_node(const char *kind, const char *path) {
    struct stat node;
    if (stat(path, &node) != 0)
        return NULL;
    return g_strdup_printf("%s %lx:%lx", kind, (gulong)node.st_dev, (gulong)node.st_ino);
}
