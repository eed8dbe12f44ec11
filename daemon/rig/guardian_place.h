/*
 * The place of a rig's guardian, which one process has at a time: an abstract Unix socket that is
 * named after the real path of the rig file. Whoever connects is told what the guardian does. A
 * guardian that makes the rig safe ends when the other side asks for its place.
 *
 * Only processes of the same user and of root are trusted. If another user holds the socket, the
 * guardian works without a place.
 */
#pragma once

#include <glib.h>
#include <poll.h>
#include <sys/types.h>

#define PLACE_MAX_ASKERS 8

struct place {
    int listener; /* -1: none */
    int askers[PLACE_MAX_ASKERS], n_askers;
};

/* Takes the place. A guardian that makes the rig safe is asked to end; one that is frozen is
 * killed. Returns FALSE, and sets ret_daemon, if the guardian of a daemon that is alive has it.
 * ret_at_work: the former guardian has not finished. Waits up to 3 s. */
gboolean place_take(struct place *place, const char *rig_path, gboolean *ret_at_work,
                    pid_t *ret_daemon);

/* The descriptors to wait for, at most 1 + PLACE_MAX_ASKERS. Returns how many. */
int place_poll(const struct place *place, struct pollfd *ret);

/* Serves those that are ready. daemon: the living daemon that is guarded, or 0: the rig is being
 * made safe. Returns whether somebody asks for the place: then end the work, and the process. */
gboolean place_serve(struct place *place, const struct pollfd *fds, int n, pid_t daemon);

/* Waits while a guardian makes the rig safe, for at most wait_us. Returns whether it still does. */
gboolean place_await(const char *rig_path, gint64 wait_us);
