#include "guardian.h"

#include "guardian_place.h"
#include "guardian_private.h"
#include "safe_state.h"

#include <errno.h>
#include <gio/gio.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define BEAT_MS        250
#define START_MS       6000           /* limit for the first answer */
#define ANSWER_US      G_USEC_PER_SEC /* maximum age of an answer that counts */
#define ASK_MS         200            /* limit for the answer to a question of guardian_answers() */
#define FROZEN_US      (3 * G_USEC_PER_SEC) /* silence after which the guardian is replaced */
#define LOOK_US        (2 * BEAT_MS * 1000) /* maximum silence that one check adds */
#define MIN_RESTART_MS 100
#define MAX_RESTART_MS 5000
/* A guardian that has run for longer than this is restarted after MIN_RESTART_MS. */
#define LASTED_US (10 * G_USEC_PER_SEC)
#define AWAIT_US  (5 * G_USEC_PER_SEC)

struct Guardian {
    char *rig_path;
    int socket; /* -1 if the guardian has to be started again */
    GPid pid;
    guint timer, watch, restart;
    guint restart_ms; /* length of the next pause before a restart */
    gboolean busy;
    gint64 started_us;
    gint64 answered_us; /* time of the guardian's last answer; 0 if there was none */
    gint64 asked_us;    /* time when guardian_answers() last waited */
    /* looked_us is the time of the last check. silent_us is the time without an answer, to which
     * each check adds at most LOOK_US. silent_us is minus START_MS when the guardian has been
     * started. */
    gint64 looked_us, silent_us;
    char *refusal; /* reason that the guardian sent instead of its first answer */
};

gboolean guardian_is_needed(const char *rig_path) {
    g_autoptr(SafeState) state = safe_state_read(rig_path, NULL);

    return state && !safe_state_is_simulated(state);
}

/* Sends a message and ignores failures, because on_ended() notices a guardian that has ended, and
 * on_beat() a guardian that is frozen. */
static void guardian_send(Guardian *guardian, enum message message) {
    const char byte = (char)message;

    if (guardian->socket >= 0 && send(guardian->socket, &byte, 1, MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
        g_debug("cannot send to the guardian: %s", g_strerror(errno));
}

/* Receives the next answer. If a guardian ends without having read a heartbeat, the kernel reports
 * ECONNRESET once, before it delivers the answers that the guardian has sent. That error is
 * ignored. */
static ssize_t receive(const Guardian *guardian, char bytes[ANSWER_MAX]) {
    const ssize_t n = recv(guardian->socket, bytes, ANSWER_MAX, MSG_DONTWAIT);
    return n < 0 && errno == ECONNRESET ? recv(guardian->socket, bytes, ANSWER_MAX, MSG_DONTWAIT)
                                        : n;
}

/* Reads all pending answers. */
static void guardian_read(Guardian *guardian) {
    char bytes[ANSWER_MAX];
    ssize_t n;

    while (guardian->socket >= 0 && (n = receive(guardian, bytes)) > 0) {
        struct answer answer;
        if ((gsize)n < sizeof answer)
            continue;
        memcpy(&answer, bytes, sizeof answer);
        if ((gsize)n > sizeof answer) {
            g_free(guardian->refusal);
            guardian->refusal = g_strndup(bytes + sizeof answer, (gsize)n - sizeof answer);
            continue;
        }
        guardian->answered_us = answer.at_us;
        guardian->silent_us = 0;
    }
}

static gboolean is_answering(Guardian *guardian) {
    guardian_read(guardian);
    return guardian->answered_us != 0 &&
           g_get_monotonic_time() - guardian->answered_us <= ANSWER_US;
}

static gboolean on_beat(gpointer data) {
    Guardian *guardian = data;
    const gint64 now = g_get_monotonic_time();

    guardian->silent_us += MIN(now - guardian->looked_us, LOOK_US);
    guardian->looked_us = now;
    guardian_read(guardian);
    if (guardian->silent_us > FROZEN_US) {
        g_warning("the guardian of %s (process %d) has not answered for %.1f s: killing it",
                  guardian->rig_path, (int)guardian->pid, FROZEN_US / 1e6);
        kill(guardian->pid, SIGKILL);
        guardian->silent_us = 0;
    }
    guardian_send(guardian, guardian->busy ? PAUSE : BEAT);
    return G_SOURCE_CONTINUE;
}

/* Runs between fork and exec, so it makes only async-signal-safe calls. Signals that end the daemon
 * must not end the guardian as well. */
static void prepare_child(gpointer unused) {
    static const int ignored[] = {SIGTERM, SIGINT, SIGHUP, SIGQUIT, SIGABRT, SIGPIPE};
    setsid();
    for (gsize i = 0; i < G_N_ELEMENTS(ignored); i++)
        signal(ignored[i], SIG_IGN);
}

static void restart_later(Guardian *guardian);

static void on_ended(GPid pid, int status, gpointer data) {
    Guardian *guardian = data;

    guardian->watch = 0;
    g_spawn_close_pid(pid);
    guardian_read(guardian);
    g_clear_handle_id(&guardian->timer, g_source_remove);
    close(guardian->socket);
    guardian->socket = -1;
    guardian->answered_us = 0;
    if (g_get_monotonic_time() - guardian->started_us > LASTED_US)
        guardian->restart_ms = MIN_RESTART_MS;
    g_warning("the guardian of %s (process %d) has ended (status 0x%04x)%s%s: starting another in "
              "%u ms",
              guardian->rig_path, (int)pid, (guint)status, guardian->refusal ? ": " : "",
              guardian->refusal ? guardian->refusal : "", guardian->restart_ms);
    restart_later(guardian);
}

/* Starts the guardian. Its standard input is one end of a socket pair, so it notices the end of the
 * daemon even if the daemon was killed. */
static gboolean do_start(Guardian *guardian, GError **error) {
    const char *const argv[] = {"/proc/self/exe", "mesorigd", "--guardian", guardian->rig_path,
                                NULL};
    const GSpawnFlags flags = G_SPAWN_FILE_AND_ARGV_ZERO | G_SPAWN_DO_NOT_REAP_CHILD;
    int fds[2];

    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) < 0) {
        g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(errno),
                    "%s: its guardian cannot be started, because no pair of sockets can be made: "
                    "%s; end other "
                    "programs on this computer, or raise its limit of open files",
                    guardian->rig_path, g_strerror(errno));
        return FALSE;
    }
    const gboolean started = g_spawn_async_with_fds(NULL, (char **)argv, NULL, flags, prepare_child,
                                                    NULL, &guardian->pid, fds[1], -1, -1, error);
    close(fds[1]);
    if (!started) {
        close(fds[0]);
        g_prefix_error(
            error,
            "%s: its guardian, which makes the rig safe if mesorigd fails, cannot be started: ",
            guardian->rig_path);
        return FALSE;
    }
    guardian->socket = fds[0];
    guardian->started_us = guardian->looked_us = g_get_monotonic_time();
    guardian->answered_us = 0;
    guardian->silent_us = -(gint64)START_MS * 1000;
    g_clear_pointer(&guardian->refusal, g_free);
    guardian->watch = g_child_watch_add(guardian->pid, on_ended, guardian);
    guardian->timer = g_timeout_add(BEAT_MS, on_beat, guardian);
    guardian_send(guardian, guardian->busy ? PAUSE : BEAT);
    return TRUE;
}

static gboolean on_restart(gpointer data) {
    Guardian *guardian = data;
    g_autoptr(GError) error = NULL;

    guardian->restart = 0;
    if (do_start(guardian, &error))
        return G_SOURCE_REMOVE;
    g_warning("%s", error->message);
    restart_later(guardian);
    return G_SOURCE_REMOVE;
}

static void restart_later(Guardian *guardian) {
    guardian->restart = g_timeout_add(guardian->restart_ms, on_restart, guardian);
    guardian->restart_ms = MIN(2 * guardian->restart_ms, MAX_RESTART_MS);
}

/* Waits for the first answer. Returns FALSE with an error if the guardian refuses, has ended, or
 * does not answer within START_MS. */
static gboolean await_first_answer(Guardian *guardian, GError **error) {
    const gint64 until = guardian->started_us + START_MS * (gint64)1000;
    struct pollfd at = {.fd = guardian->socket, .events = POLLIN};
    gint64 left_us;

    while ((left_us = until - g_get_monotonic_time()) > 0) {
        if (poll(&at, 1, (int)(left_us / 1000) + 1) < 0 && errno != EINTR)
            break;
        guardian_read(guardian);
        if (guardian->answered_us != 0)
            return TRUE;
        if (guardian->refusal || at.revents & POLLHUP)
            break;
    }
    if (guardian->refusal)
        return device_error_set(error, DEVICE_ERROR_BUSY, NULL, "%s", guardian->refusal);
    if (at.revents & POLLHUP)
        return device_error_set(
            error, DEVICE_ERROR_DISCONNECTED, NULL,
            "the guardian of %s (process %d) has ended" ERROR_ADVICE
            "read the messages of mesorigd; if they have no reason, the guardian "
            "has crashed: start mesorigd again",
            guardian->rig_path, (int)guardian->pid);
    kill(guardian->pid, SIGKILL);
    return device_error_set(
        error, DEVICE_ERROR_TIMEOUT, NULL,
        "the guardian of %s (process %d) has not answered within %g s of its start" ERROR_ADVICE
        "check whether this computer is overloaded",
        guardian->rig_path, (int)guardian->pid, START_MS / 1e3);
}

static Guardian *guardian_new(const char *rig_path) {
    Guardian *guardian = g_new0(Guardian, 1);

    guardian->rig_path = g_strdup(rig_path);
    guardian->socket = -1;
    guardian->restart_ms = MIN_RESTART_MS;
    return guardian;
}

Guardian *guardian_start(const char *rig_path, GError **error) {
    Guardian *guardian = guardian_new(rig_path);

    if (do_start(guardian, error) && await_first_answer(guardian, error))
        return guardian;
    /* The guardian is told that the rig is safe, because no device has been opened. A guardian that
     * has refused may be making the rig safe after an earlier daemon, and continues to do so. */
    guardian_end(guardian, GUARDIAN_SAFE);
    return NULL;
}

gboolean guardian_answers(Guardian *guardian, GError **error) {
    if (is_answering(guardian))
        return TRUE;
    /* Wait at most once in ANSWER_US, because the main loop has other work. */
    if (guardian->socket >= 0 && g_get_monotonic_time() - guardian->asked_us > ANSWER_US) {
        const gint64 until = g_get_monotonic_time() + ASK_MS * (gint64)1000;
        guardian->asked_us = g_get_monotonic_time();
        struct pollfd at = {.fd = guardian->socket, .events = POLLIN};
        gint64 left_us;
        guardian_send(guardian, BEAT);
        while ((left_us = until - g_get_monotonic_time()) > 0 && !(at.revents & POLLHUP)) {
            poll(&at, 1, (int)(left_us / 1000) + 1);
            if (is_answering(guardian))
                return TRUE;
        }
    }
    return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                            "the guardian of %s does not answer, so nobody would switch a laser "
                            "off if this program died" ERROR_ADVICE
                            "the guardian is being started again: try again in a few seconds",
                            guardian->rig_path);
}

void guardian_set_busy(Guardian *guardian, gboolean busy) {
    if (!guardian)
        return;
    guardian->busy = busy;
    guardian_send(guardian, busy ? PAUSE : BEAT);
}

static void on_gone(GPid pid, int status, gpointer unused) {
    g_spawn_close_pid(pid);
}

static void let_go(Guardian *guardian) {
    if (guardian->watch) {
        GSource *watch = g_main_context_find_source_by_id(NULL, guardian->watch);
        g_source_set_callback(watch, G_SOURCE_FUNC(on_gone), NULL, NULL);
    }
    guardian->watch = 0;
}

/* Checks whether the guardian has ended since the main loop last ran, and closes its socket in this
 * case. */
static void notice_end(Guardian *guardian) {
    struct pollfd at = {.fd = guardian->socket, .events = POLLIN};

    guardian_read(guardian);
    if (guardian->socket < 0 || poll(&at, 1, 0) < 1 || !(at.revents & POLLHUP))
        return;
    let_go(guardian);
    g_clear_handle_id(&guardian->timer, g_source_remove);
    close(guardian->socket);
    guardian->socket = -1;
}

void guardian_end(Guardian *guardian, enum guardian_end how) {
    g_autoptr(GError) error = NULL;

    if (!guardian)
        return;
    g_clear_handle_id(&guardian->restart, g_source_remove);
    notice_end(guardian);
    if (guardian->socket < 0 && how != GUARDIAN_SAFE && !do_start(guardian, &error))
        g_warning("%s", error->message);
    g_clear_handle_id(&guardian->timer, g_source_remove);
    if (how != GUARDIAN_UNSAFE)
        guardian_send(guardian, how == GUARDIAN_SAFE ? GOODBYE : FAILED);
    if (guardian->socket >= 0)
        close(guardian->socket);
    let_go(guardian);
    g_free(guardian->rig_path);
    g_free(guardian->refusal);
    g_free(guardian);
}

gboolean guardian_await(const char *rig_path) {
    return place_await(rig_path, AWAIT_US);
}

void guardian_leave(const char *rig_path) {
    guardian_end(guardian_new(rig_path), GUARDIAN_FAILED);
}
