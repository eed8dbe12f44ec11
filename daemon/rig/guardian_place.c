#include "guardian_place.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define HELLO_MS   1000 /* limit for the answer of a guardian about its task */
#define LOOK_MS    100  /* limit for that answer in place_await() */
#define END_MS     1000 /* limit for a guardian to end */
#define TAKE_US    (3 * G_USEC_PER_SEC)
#define RETRY_US   (10 * 1000)
#define GIVE_PLACE 't'

struct hello {
    pid_t daemon; /* 0 while the rig is being made safe */
};

static socklen_t place_address(const char *rig_path, struct sockaddr_un *ret) {
    g_autofree char *real = realpath(rig_path, NULL);
    g_autofree char *sum =
        g_compute_checksum_for_string(G_CHECKSUM_SHA256, real ? real : rig_path, -1);
    memset(ret, 0, sizeof *ret);
    ret->sun_family = AF_UNIX; /* sun_path begins with 0, so the name is abstract and not a file */
    const int n =
        g_snprintf(ret->sun_path + 1, sizeof ret->sun_path - 1, "mesorigd-guardian-%s", sum);
    return (socklen_t)(G_STRUCT_OFFSET(struct sockaddr_un, sun_path) + 1 + (gsize)n);
}

/* Returns the process at the other end of a connection, or 0 if that process is not trusted. A
 * process is trusted if its user is root or the user of this process, or if this process belongs
 * to root. For a connection made by place_connect(), the other process is the one that listens. */
static pid_t peer_of(int fd) {
    struct ucred peer;
    socklen_t size = sizeof peer;

    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) < 0)
        return 0;
    return peer.uid == geteuid() || peer.uid == 0 || geteuid() == 0 ? peer.pid : 0;
}

static gboolean is_ready(int fd, int wait_ms) {
    struct pollfd at = {.fd = fd, .events = POLLIN};

    return poll(&at, 1, wait_ms) > 0;
}

/* Waits up to wait_ms until the other process has closed the connection. Returns whether it has. */
static gboolean is_closed(int fd, int wait_ms) {
    char byte;

    return is_ready(fd, wait_ms) && recv(fd, &byte, 1, MSG_DONTWAIT) <= 0;
}

static void kill_frozen(pid_t pid) {
    const int process = pidfd_open(pid, 0);

    g_printerr("mesorigd: guardian: the guardian before this one (process %d) does not answer: "
               "killing it\n",
               (int)pid);
    if (process < 0 || pidfd_send_signal(process, SIGKILL, NULL, 0) < 0)
        g_printerr("mesorigd: guardian: cannot kill process %d: %s\n", (int)pid, g_strerror(errno));
    else
        is_ready(process, END_MS);
    if (process >= 0)
        close(process);
}

enum former { FORMER_GONE, FORMER_WATCHES, FORMER_AT_WORK, FORMER_STRANGER };

/* If the guardian at the other end of a connection does not watch a running daemon, asks it to end,
 * and sets *ret_at_work to TRUE because it was making the rig safe. Kills a guardian that does not
 * answer or does not end. If the guardian watches a daemon, *ret_daemon is the process number of
 * the daemon. */
static enum former ask_former(int fd, gboolean *ret_at_work, pid_t *ret_daemon) {
    const pid_t pid = peer_of(fd);
    const char take = GIVE_PLACE;
    struct hello hello;

    if (pid == 0)
        return FORMER_STRANGER;
    if (!is_ready(fd, HELLO_MS)) {
        /* A guardian that does not answer is assumed to make the rig safe. If it watches a daemon
         * that is alive, nothing is lost, because that daemon has locked its devices. */
        *ret_at_work = TRUE;
        kill_frozen(pid);
        return FORMER_AT_WORK;
    }
    if (recv(fd, &hello, sizeof hello, MSG_DONTWAIT) != sizeof hello)
        return FORMER_GONE;
    if (hello.daemon != 0) {
        *ret_daemon = hello.daemon;
        /* The guardian may just be ending, because its daemon has ended. */
        return is_closed(fd, END_MS) ? FORMER_GONE : FORMER_WATCHES;
    }
    *ret_at_work = TRUE;
    if (send(fd, &take, 1, MSG_NOSIGNAL) == 1 && !is_closed(fd, END_MS))
        kill_frozen(pid);
    return FORMER_AT_WORK;
}

static gboolean try_listen(struct place *place, const struct sockaddr_un *name, socklen_t size) {
    const int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd >= 0 && bind(fd, (const struct sockaddr *)name, size) == 0 &&
        listen(fd, PLACE_MAX_ASKERS) == 0) {
        place->listener = fd;
        return TRUE;
    }
    if (fd >= 0)
        close(fd);
    return FALSE;
}

static int place_connect(const struct sockaddr_un *name, socklen_t size) {
    const int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd < 0 || connect(fd, (const struct sockaddr *)name, size) == 0)
        return fd;
    close(fd);
    return -1;
}

gboolean place_take(struct place *place, const char *rig_path, gboolean *ret_at_work,
                    pid_t *ret_daemon) {
    const gint64 until = g_get_monotonic_time() + TAKE_US;
    enum former former = FORMER_GONE;
    struct sockaddr_un name;
    const socklen_t size = place_address(rig_path, &name);

    *place = (struct place){.listener = -1};
    *ret_at_work = FALSE;
    while (former != FORMER_STRANGER && g_get_monotonic_time() < until) {
        if (try_listen(place, &name, size))
            return TRUE;
        const int fd = place_connect(&name, size);
        former = FORMER_GONE;
        if (fd >= 0) {
            former = ask_former(fd, ret_at_work, ret_daemon);
            close(fd);
        }
        if (former == FORMER_WATCHES)
            return FALSE;
        g_usleep(RETRY_US);
    }
    if (former == FORMER_STRANGER)
        g_printerr("mesorigd: guardian: a process of another user answers as the guardian of this "
                   "rig. This guardian protects the rig too, but a later mesorigd does not find "
                   "it; end the other process\n");
    else
        g_printerr("mesorigd: guardian: an earlier guardian of this rig did not end within %d s. "
                   "This guardian protects the rig too, but a later mesorigd does not find it; end "
                   "the earlier mesorigd\n",
                   (int)(TAKE_US / G_USEC_PER_SEC));
    return TRUE;
}

int place_poll(const struct place *place, struct pollfd *ret) {
    ret[0] = (struct pollfd){.fd = place->listener, .events = POLLIN};
    for (int i = 0; i < place->n_askers; i++)
        ret[1 + i] = (struct pollfd){.fd = place->askers[i], .events = POLLIN};
    return 1 + place->n_askers;
}

static void place_greet(struct place *place, pid_t daemon) {
    const struct hello hello = {daemon};
    const int fd = accept4(place->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

    if (fd < 0)
        return;
    if (place->n_askers < PLACE_MAX_ASKERS && peer_of(fd) != 0 &&
        send(fd, &hello, sizeof hello, MSG_NOSIGNAL) == sizeof hello)
        place->askers[place->n_askers++] =
            fd; /* kept open, so that the other process notices when this process ends */
    else
        close(fd);
}

gboolean place_serve(struct place *place, const struct pollfd *fds, int n, pid_t daemon) {
    gboolean asked = FALSE;

    for (int i = n - 1; i > 0; i--) {
        char byte = 0;
        if (!fds[i].revents)
            continue;
        if (recv(fds[i].fd, &byte, 1, MSG_DONTWAIT) == 1) {
            asked |= byte == GIVE_PLACE && daemon == 0;
            continue;
        }
        close(fds[i].fd);
        place->askers[i - 1] = place->askers[--place->n_askers];
    }
    if (fds[0].revents)
        place_greet(place, daemon);
    return asked;
}

gboolean place_await(const char *rig_path, gint64 wait_us) {
    struct sockaddr_un name;
    const socklen_t size = place_address(rig_path, &name);
    const int fd = place_connect(&name, size);
    gboolean at_work = FALSE;
    struct hello hello;

    if (fd < 0)
        return FALSE;
    if (peer_of(fd) != 0 && is_ready(fd, LOOK_MS) &&
        recv(fd, &hello, sizeof hello, MSG_DONTWAIT) == sizeof hello && hello.daemon == 0)
        at_work = !is_closed(fd, (int)(wait_us / 1000));
    close(fd);
    return at_work;
}
