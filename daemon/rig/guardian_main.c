/* The process of the guardian. */
#include "guardian.h"
#include "guardian_place.h"
#include "guardian_private.h"
#include "safe_work.h"

#include "drivers/lock.h"

#include <errno.h>
#include <signal.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#define HANG_US                                                                                    \
    (4500 * 1000)   /* silence that counts as a hang; all lights are off within 5 s of the last    \
                       heartbeat */
#define LOOK_MS 250 /* time between two looks at the clock */
#define LOOK_US (2 * LOOK_MS * 1000) /* maximum silence that one look adds */
#define END_MS  5000                 /* time limit for a killed daemon to end */
/* time after which a new daemon that waits for the rig gets a refusal */
#define WAIT_US  (2 * G_USEC_PER_SEC)
#define REPEAT_S 60 /* time between two messages about the same device */

struct guarding {
    const char *rig_path;
    SafeState *state;
    struct place place;
    pid_t daemon;
    int process; /* pidfd of the daemon; -1 if there is none */
    /* silent_us is the time since the daemon's last heartbeat. looked_us is the time of the last
     * look at the clock. Each look adds at most LOOK_US to silent_us. */
    gint64 silent_us, looked_us;
    gboolean pause; /* the daemon has said that heartbeats may be missing (PAUSE) */
};

/* Adds the time since the last look to silent_us, but at most LOOK_US. If more time has passed,
 * this process was delayed, and probably the daemon too, because a virtual machine stood still or
 * other processes used the processor. */
static void look_at_clock(struct guarding *guarding) {
    const gint64 now_us = g_get_monotonic_time();

    guarding->silent_us += MIN(now_us - guarding->looked_us, LOOK_US);
    guarding->looked_us = now_us;
}

static int silence_wait_ms(const struct guarding *guarding) {
    const gint64 left_us = MAX(HANG_US - guarding->silent_us, 0);

    return guarding->pause ? -1 : (int)MIN(left_us / 1000 + 1, LOOK_MS);
}

/* Sends the refusal to the daemon or, if refusal is NULL, the answer to a heartbeat. */
static void answer(const char *refusal) {
    const struct answer answer = {g_get_monotonic_time()};
    g_autoptr(GByteArray) packet = g_byte_array_new();

    g_byte_array_append(packet, (const guint8 *)&answer, sizeof answer);
    if (refusal)
        g_byte_array_append(packet, (const guint8 *)refusal,
                            (guint)MIN(strlen(refusal), ANSWER_MAX - sizeof answer));
    if (send(STDIN_FILENO, packet->data, packet->len, MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
        g_debug("cannot answer the daemon: %s", g_strerror(errno));
}

/* What the guardian has learnt about the daemon: nothing new, a final message, or its end. */
enum news { NEWS_NONE, NEWS_GOODBYE, NEWS_DEAD, NEWS_FAILED };

/* Receives a byte from the daemon, like recv(). If a daemon ends without having read all answers,
 * the kernel reports ECONNRESET once, before it delivers the data that the daemon has sent. That
 * error is ignored. */
static ssize_t receive_byte(char *ret) {
    const ssize_t n = recv(STDIN_FILENO, ret, 1, MSG_DONTWAIT);

    return n < 0 && errno == ECONNRESET ? recv(STDIN_FILENO, ret, 1, MSG_DONTWAIT) : n;
}

static enum news receive(struct guarding *guarding) {
    enum news news = NEWS_NONE;
    gboolean beat = FALSE;
    char byte = 0;
    ssize_t n;

    while (news == NEWS_NONE && (n = receive_byte(&byte)) > 0) {
        if (byte == GOODBYE || byte == FAILED)
            news = byte == GOODBYE ? NEWS_GOODBYE : NEWS_FAILED;
        guarding->silent_us = 0;
        guarding->pause = byte == PAUSE;
        beat = TRUE;
    }
    if (news != NEWS_NONE)
        return news;
    if (n == 0 || (errno != EAGAIN && errno != EINTR))
        return NEWS_DEAD;
    if (beat)
        answer(NULL);
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

/* Waits until the daemon sends a final message, dies or hangs. A daemon that hangs is killed. */
static enum news watch_daemon(struct guarding *guarding) {
    guarding->looked_us = g_get_monotonic_time();
    for (;;) {
        struct pollfd at[3 + PLACE_MAX_ASKERS] = {{.fd = STDIN_FILENO, .events = POLLIN},
                                                  {.fd = guarding->process, .events = POLLIN}};
        const int n = place_poll(&guarding->place, at + 2);
        const int ready = poll(at, 2 + (nfds_t)n, silence_wait_ms(guarding));
        if (ready < 0 && errno != EINTR)
            return NEWS_DEAD;
        look_at_clock(guarding);
        if (ready > 0) {
            enum news news = NEWS_NONE;
            if (at[0].revents)
                news = receive(guarding);
            else if (at[1].revents)
                news = NEWS_DEAD;
            if (news != NEWS_NONE)
                return news;
            place_serve(&guarding->place, at + 2, n, guarding->daemon);
        }
        if (!guarding->pause && guarding->silent_us >= HANG_US) {
            kill_daemon(guarding->process);
            return NEWS_DEAD;
        }
    }
}

/* Makes the rig safe, until nothing is left to try. If a new daemon waits for the rig
 * (daemon_waits), it gets a refusal after WAIT_US. *ret_safe is TRUE if every device is safe.
 * Returns FALSE if another guardian has asked for the place. */
static gboolean work(struct guarding *guarding, enum safe_until until, gboolean daemon_waits,
                     gboolean *ret_safe) {
    const gint64 began_us = g_get_monotonic_time();
    SafeWork *work = safe_work_new(guarding->state, until, REPEAT_S);
    gboolean asked = FALSE, going = TRUE;

    while (going && !asked) {
        struct pollfd at[1 + PLACE_MAX_ASKERS];
        const int n = place_poll(&guarding->place, at);
        const gint64 past_us = g_get_monotonic_time() - began_us;
        if (daemon_waits && past_us >= WAIT_US) {
            g_autofree char *unsafe = safe_work_unsafe(work);
            g_autofree char *refusal = g_strdup_printf(
                "%s is not opened: it has not been safe since an earlier mesorigd ended, and "
                "process %d is still trying" ERROR_ADVICE "look at these devices: %s",
                guarding->rig_path, (int)getpid(), unsafe);
            answer(refusal);
            daemon_waits = FALSE;
        }
        const int wait_ms = daemon_waits ? (int)((WAIT_US - past_us) / 1000) + 1 : -1;
        going = safe_work_run(work, at, n, wait_ms);
        asked = place_serve(&guarding->place, at, n, 0);
    }
    if (asked)
        g_printerr("mesorigd: guardian: process %d leaves the rig to another guardian\n",
                   (int)getpid());
    *ret_safe = safe_work_is_safe(work);
    safe_work_free(work);
    return !asked;
}

/* Sets daemon to the process at the other end of the standard input, and process to a pidfd of it.
 * If the daemon is no longer the parent, it has died, and process is -1. */
static void find_daemon(struct guarding *guarding) {
    struct ucred peer = {0};
    socklen_t size = sizeof peer;

    if (getsockopt(STDIN_FILENO, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0)
        guarding->daemon = peer.pid;
    guarding->process = guarding->daemon == getppid() ? pidfd_open(guarding->daemon, 0) : -1;
}

/* Takes the place, and finishes the work of a guardian that has given the place up. Returns FALSE
 * if the guardian of a running daemon has the place, or if another guardian has asked for it. A
 * device that cannot be made safe because of a mistake in the rig file does not matter here,
 * because the daemon reports the mistake. */
static gboolean begin(struct guarding *guarding) {
    gboolean at_work = FALSE, safe = FALSE;
    pid_t other = 0;

    if (!place_take(&guarding->place, guarding->rig_path, &at_work, &other)) {
        g_autofree char *refusal =
            g_strdup_printf("%s is open in another mesorigd (process %d)" ERROR_ADVICE
                            "use that daemon instead, or end it",
                            guarding->rig_path, (int)other);
        answer(refusal);
        return FALSE;
    }
    return !at_work || work(guarding, SAFE_UNTIL_SAFE_QUIETLY, TRUE, &safe);
}

int guardian_main(const char *rig_path) {
    struct guarding guarding = {.rig_path = rig_path};
    g_autoptr(GError) error = NULL;
    gboolean safe = FALSE;

    prctl(PR_SET_NAME, "mesorig-guard"); /* the name would be "exe" otherwise */
    lock_set_role(LOCK_GUARDIAN);
    find_daemon(&guarding);
    guarding.state = safe_state_read(rig_path, &error);
    if (!guarding.state) {
        answer(error->message);
        g_printerr("mesorigd: guardian: NOT safe: %s\n", error->message);
        return 1;
    }
    if (begin(&guarding)) {
        const enum news news = watch_daemon(&guarding);
        safe = news == NEWS_GOODBYE;
        if (news == NEWS_DEAD)
            g_printerr("mesorigd: guardian: the daemon has ended and has not reported that it left "
                       "the rig safe: making %s safe\n",
                       rig_path);
        if (!safe)
            work(&guarding, news == NEWS_FAILED ? SAFE_UNTIL_SAFE_QUIETLY : SAFE_UNTIL_SAFE, FALSE,
                 &safe);
    }
    safe_state_free(guarding.state);
    return safe ? 0 : 1;
}
