/*
 * The place of a rig's guardian, which only one process can hold. It is an abstract Unix socket
 * that is named after the real path of the rig file. The guardian tells a process that connects to
 * the socket whether it watches a daemon or makes the rig safe. A guardian that makes the rig safe
 * ends when that process asks for its place.
 *
 * Only processes of the same user and of root are trusted; a guardian of root trusts every process.
 * If a process that is not trusted holds the socket, the guardian works without a place.
 */
#pragma once

#include <glib.h>
#include <poll.h>
#include <sys/types.h>

#define PLACE_MAX_ASKERS 8

struct place {
    int listener; /* -1 if the place is not held */
    int askers[PLACE_MAX_ASKERS], n_askers;
};

/* Takes the place. If a guardian that makes the rig safe holds the place, that guardian is asked to
 * end, and killed if it does not react. *ret_at_work is TRUE if that guardian has not finished its
 * work. Returns FALSE if the guardian of a running daemon holds the place; *ret_daemon is then the
 * process number of that daemon. Waits up to about 3 s. If the place cannot be taken in this time,
 * or a process that is not trusted holds it, returns TRUE without the place. */
gboolean place_take(struct place *place, const char *rig_path, gboolean *ret_at_work,
                    pid_t *ret_daemon);

/* Sets the descriptors to wait for in ret, which has room for 1 + PLACE_MAX_ASKERS. Returns their
 * number. */
int place_poll(const struct place *place, struct pollfd *ret);

/* Serves the descriptors that are ready. daemon is the process number of the running daemon, or 0
 * if the rig is being made safe. Returns whether another process asks for the place. The caller
 * must then end its work and the process. */
gboolean place_serve(struct place *place, const struct pollfd *fds, int n, pid_t daemon);

/* If a guardian makes the rig safe, waits at most wait_us until it has ended. Returns whether it is
 * still at work. */
gboolean place_await(const char *rig_path, gint64 wait_us);
