#include "guardian.h"

#include "safe_state.h"

#include "drivers/lock.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <sys/pidfd.h>
#include <sys/socket.h>
#include <unistd.h>

#define BEAT_MS    1000
#define HANG_US    (4500 * 1000) /* the rig is dark within five seconds after the daemon has hung */
#define LOOK_MS    250           /* between two looks of the guardian at the clock */
#define LOOK_US    (2 * LOOK_MS * 1000) /* the longest silence that it knows of from one look */
#define END_MS     5000                 /* time that a killed daemon gets to end */
#define RESTART_US (10 * G_USEC_PER_SEC)

enum message { BEAT = 'b', PAUSE = 'p', GOODBYE = 'q' };

struct Guardian {
    char *rig_path;
    int socket;
    guint timer, watch;
    gint64 started_us;
};

static gboolean is_real(const struct device *device) {
    return !g_str_has_prefix(device->info->name, "sim-");
}

gboolean guardian_is_needed(const struct devices *devices) {
    gboolean real = FALSE;

    for (int i = 0; i < DEVICES_POSITIONERS; i++) {
        const Axis *axis = devices_positioner(devices, i);
        real |= axis && is_real(&axis->device);
    }
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        real |= is_real(&devices->lasers[i]->device) || is_real(&devices->sweeps[i]->device);
    for (int i = 0; i < devices->n_banks; i++)
        real |= is_real(&devices->banks[i]->device);
    return real;
}

/* Sends a byte. Ignores failures, since on_ended() reports a guardian that has ended. */
static void guardian_send(Guardian *guardian, enum message message) {
    const char byte = (char)message;
    if (send(guardian->socket, &byte, 1, MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
        g_debug("cannot send to the guardian: %s", g_strerror(errno));
}

static gboolean on_beat(gpointer data) {
    guardian_send(data, BEAT);
    return G_SOURCE_CONTINUE;
}

/* Runs between fork and exec: async-signal-safe calls only. Signals that end the daemon must not
 * end the guardian too. */
static void guardian_prepare_child(gpointer unused) {
    static const int ignored[] = {SIGTERM, SIGINT, SIGHUP, SIGQUIT, SIGABRT, SIGPIPE};
    setsid();
    for (gsize i = 0; i < G_N_ELEMENTS(ignored); i++)
        signal(ignored[i], SIG_IGN);
}

static gboolean guardian_do_start(Guardian *guardian, GError **error);

static void on_ended(GPid pid, int status, gpointer data) {
    Guardian *guardian = data;
    const gboolean lasted = g_get_monotonic_time() - guardian->started_us > RESTART_US;
    g_autoptr(GError) error = NULL;

    guardian->watch = 0;
    g_spawn_close_pid(pid);
    g_clear_handle_id(&guardian->timer, g_source_remove);
    close(guardian->socket);
    guardian->socket = -1;
    g_warning("the guardian of %s has ended (status 0x%04x)%s", guardian->rig_path, (guint)status,
              lasted ? "; starting it again"
                     : ": if this program dies, nobody switches lasers and lamps off");
    if (lasted && !guardian_do_start(guardian, &error))
        g_warning("%s", error->message);
}

/* Its standard input is one end of a socket pair, so that it notices the end of the daemon however
 * that dies. */
static gboolean guardian_do_start(Guardian *guardian, GError **error) {
    const char *const argv[] = {"/proc/self/exe", "mesorigd", "--guardian", guardian->rig_path,
                                NULL};
    const GSpawnFlags flags = G_SPAWN_FILE_AND_ARGV_ZERO | G_SPAWN_DO_NOT_REAP_CHILD;
    int fds[2];
    GPid pid;

    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds) < 0) {
        g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(errno),
                    "no guardian for %s: cannot make a pair of sockets: %s", guardian->rig_path,
                    g_strerror(errno));
        return FALSE;
    }
    const gboolean started =
        g_spawn_async_with_fds(NULL, (char **)argv, NULL, flags, guardian_prepare_child, NULL, &pid,
                               fds[1], -1, -1, error);
    close(fds[1]);
    if (!started) {
        close(fds[0]);
        g_prefix_error(error, "no guardian for %s: ", guardian->rig_path);
        return FALSE;
    }
    guardian->socket = fds[0];
    guardian->started_us = g_get_monotonic_time();
    guardian->watch = g_child_watch_add(pid, on_ended, guardian);
    guardian->timer = g_timeout_add(BEAT_MS, on_beat, guardian);
    return TRUE;
}

Guardian *guardian_start(const char *rig_path, GError **error) {
    Guardian *guardian = g_new0(Guardian, 1);

    guardian->rig_path = g_strdup(rig_path);
    if (guardian_do_start(guardian, error))
        return guardian;
    g_free(guardian->rig_path);
    g_free(guardian);
    return NULL;
}

void guardian_set_busy(Guardian *guardian, gboolean busy) {
    if (guardian && guardian->socket >= 0)
        guardian_send(guardian, busy ? PAUSE : BEAT);
}

static void guardian_on_gone(GPid pid, int status, gpointer unused) {
    g_spawn_close_pid(pid);
}

void guardian_end(Guardian *guardian, gboolean safe) {
    if (!guardian)
        return;
    g_clear_handle_id(&guardian->timer, g_source_remove);
    if (guardian->socket >= 0) {
        if (safe)
            guardian_send(guardian, GOODBYE);
        close(guardian->socket);
    }
    if (guardian->watch) {
        GSource *watch = g_main_context_find_source_by_id(NULL, guardian->watch);
        g_source_set_callback(watch, G_SOURCE_FUNC(guardian_on_gone), NULL, NULL);
    }
    g_free(guardian->rig_path);
    g_free(guardian);
}

/* How long the daemon has been silent. */
struct silence {
    gint64 looked_us; /* at the clock */
    gint64 us;        /* since the last beat, as far as this process has run meanwhile */
    gboolean allowed;
};

/* Between two looks this process may have been held up (a virtual machine that stood still, a
 * processor that others have taken), and the daemon with it. Of such a time only LOOK_US count. */
static void silence_look(struct silence *silence) {
    const gint64 now_us = g_get_monotonic_time();
    silence->us += MIN(now_us - silence->looked_us, LOOK_US);
    silence->looked_us = now_us;
}

static int silence_wait_ms(const struct silence *silence) {
    const gint64 left_us = MAX(HANG_US - silence->us, 0);
    return silence->allowed ? -1 : (int)MIN(left_us / 1000 + 1, LOOK_MS);
}

/* The bytes that the daemon has sent. */
enum news { NEWS_NONE, NEWS_GOODBYE, NEWS_DEAD };

static enum news guardian_receive(struct silence *silence) {
    char bytes[64];
    const ssize_t n = recv(STDIN_FILENO, bytes, sizeof bytes, MSG_DONTWAIT);

    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR))
        return NEWS_DEAD;
    for (ssize_t i = 0; i < n; i++) {
        if (bytes[i] == GOODBYE)
            return NEWS_GOODBYE;
        silence->us = 0;
        silence->allowed = bytes[i] == PAUSE;
    }
    return NEWS_NONE;
}

static void kill_daemon(int daemon) {
    struct pollfd at = {.fd = daemon, .events = POLLIN};

    g_printerr("mesorigd: guardian: no heartbeat from the daemon for %.1f s: killing it\n",
               HANG_US / 1e6);
    if (daemon < 0 || pidfd_send_signal(daemon, SIGKILL, NULL, 0) < 0)
        g_printerr("mesorigd: guardian: cannot kill the daemon: %s\n", g_strerror(errno));
    else
        poll(&at, 1, END_MS);
}

/* Waits until the daemon says goodbye, dies or hangs; returns whether to make the rig safe. */
static gboolean watch_daemon(int daemon) {
    struct silence silence = {.looked_us = g_get_monotonic_time()};

    for (;;) {
        struct pollfd at[] = {{.fd = STDIN_FILENO, .events = POLLIN},
                              {.fd = daemon, .events = POLLIN}};
        const int ready = poll(at, G_N_ELEMENTS(at), silence_wait_ms(&silence));
        if (ready < 0 && errno != EINTR)
            return TRUE;
        silence_look(&silence);
        if (ready > 0) {
            const enum news news = at[0].revents ? guardian_receive(&silence) : NEWS_DEAD;
            if (news != NEWS_NONE)
                return news == NEWS_DEAD;
        }
        if (!silence.allowed && silence.us >= HANG_US) {
            kill_daemon(daemon);
            return TRUE;
        }
    }
}

int guardian_main(const char *rig_path) {
    const int daemon = pidfd_open(getppid(), 0);
    g_autoptr(GError) error = NULL;
    g_autoptr(SafeState) state = safe_state_read(rig_path, &error);

    lock_set_role(LOCK_GUARDIAN);
    if (!watch_daemon(daemon))
        return 0;
    g_printerr(
        "mesorigd: guardian: the daemon has ended and has not reported that it left the rig safe: "
        "making %s safe\n",
        rig_path);
    if (!state) {
        g_printerr("mesorigd: guardian: NOT safe: %s\n", error->message);
        return 1;
    }
    return safe_state_make(state) ? 0 : 1;
}
