/*
 * A small process that makes the rig safe when the daemon cannot: when the daemon has died without
 * saying goodbye, or when its main loop hangs; then the guardian kills it. It goes on until every
 * device is safe.
 *
 * A timer of the default main context sends the guardian a heartbeat four times a second, in real
 * time whatever clock the rig has, and the guardian answers each one. A guardian that has ended is
 * started again after 100 ms, and after longer pauses of at most 5 s if it ends again and again.
 * One that has not answered for 3 s is killed and started again. Neither side counts more than half
 * a second of silence for a time in which it was held up itself, because a computer that stands
 * still holds up the other side as well.
 *
 * A rig file has one guardian. That of a daemon that is alive keeps other daemons from the rig; one
 * that is making the rig safe gives way to that of another daemon, which goes on with its work.
 *
 * All functions belong to the main loop's thread.
 */
#pragma once

#include "devices.h"

typedef struct Guardian Guardian;

/* Whether the rig file names a laser, lamps or an axis that is not simulated. FALSE also for a file
 * that cannot be read. */
gboolean guardian_is_needed(const char *rig_path);

/* Starts this program again with --guardian RIG, and waits until it has answered, for at most 6 s.
 * To be called before the devices are opened. Fails also if another daemon has this rig, and if the
 * rig has not been safe since an earlier daemon died; a guardian then goes on with making it safe.
 */
Guardian *guardian_start(const char *rig_path, GError **error);

/* TRUE if the guardian has answered within the last second. Asks once more, and waits up to 200 ms,
 * if no answer has come for longer, because this process may have been busy. Whoever switches a
 * laser on asks this first. */
gboolean guardian_answers(Guardian *guardian, GError **error);

/* busy: no light is on, nothing moves and the main loop may block, so silence is not a hang. FALSE:
 * it is one again, from now on. NULL is ignored. */
void guardian_set_busy(Guardian *guardian, gboolean busy);

enum guardian_end {
    GUARDIAN_SAFE,   /* every device has confirmed that it is safe: the guardian ends */
    GUARDIAN_UNSAFE, /* the guardian makes the rig safe */
    GUARDIAN_FAILED, /* the same, since the rig could not be opened; says only what is not safe */
};

/* NULL is ignored. */
void guardian_end(Guardian *guardian, enum guardian_end how);

/* For a program that makes the rig safe itself: waits up to 5 s while a guardian does so. Returns
 * whether it is still at work. */
gboolean guardian_await(const char *rig_path);

/* Starts a guardian for a rig without a daemon, which makes the rig safe and says only what is not.
 */
void guardian_leave(const char *rig_path);

/* The guardian itself; its standard input is the daemon's socket. Returns the exit code. */
int guardian_main(const char *rig_path);
