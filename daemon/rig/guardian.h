/*
 * The guardian: a small process that makes the rig safe when the daemon cannot. It acts when the
 * daemon has died without reporting that the rig is safe. It also acts when the daemon's main loop
 * hangs, which means that no heartbeat has come for 4.5 s. It then kills the daemon first. It
 * commands the devices until every device is safe.
 *
 * A timer of the default main context sends the guardian a heartbeat four times a second. The timer
 * uses real time, even if the rig has another clock. The guardian answers each heartbeat. A
 * guardian that has ended is started again after 100 ms. If it ends repeatedly, the pauses grow to
 * at most 5 s. A guardian that has not answered for 3 s is killed and started again. If a process
 * was itself delayed, it counts that time as at most half a second of silence of the other process,
 * because a computer that stands still delays both.
 *
 * A rig file has one guardian. The guardian of a running daemon prevents other daemons from
 * opening the rig. A guardian that is making the rig safe gives way to the guardian of a new
 * daemon, which continues its work.
 *
 * All functions belong to the main loop's thread.
 */
#pragma once

#include "devices.h"

typedef struct Guardian Guardian;

/* Returns whether the rig file names a laser, lamps or an axis that is not simulated. Returns FALSE
 * for a file that cannot be read. */
gboolean guardian_is_needed(const char *rig_path);

/* Starts this program again with --guardian RIG as a guardian, and waits at most 6 s for its first
 * answer. Call the function before the devices are opened. Returns NULL with an error if there is
 * no answer, if another daemon has this rig, or if an earlier daemon has died and the rig is not
 * safe yet. In the last case another guardian continues to make the rig safe. */
Guardian *guardian_start(const char *rig_path, GError **error);

/* Returns TRUE if the guardian has answered within the last second. If the last answer is older,
 * this process may have been busy. The function then sends a heartbeat and waits up to 200 ms for
 * the answer, at most once a second. Returns FALSE with an error if there is no answer. Call it
 * before a laser is switched on. */
gboolean guardian_answers(Guardian *guardian, GError **error);

/* With busy TRUE, tells the guardian that the main loop may block, so that missing heartbeats do
 * not mean a hang. No light may be on and no axis may move meanwhile. With busy FALSE, missing
 * heartbeats mean a hang again. guardian may be NULL, which is ignored. */
void guardian_set_busy(Guardian *guardian, gboolean busy);

enum guardian_end {
    GUARDIAN_SAFE, /* every device has confirmed that it is safe, so the guardian ends */
    /* A device has not confirmed that it is safe, so the guardian makes the rig safe. */
    GUARDIAN_UNSAFE,
    /* The rig could not be opened. The guardian makes it safe as with GUARDIAN_UNSAFE, but prints
     * nothing about a device that is made safe at the first attempt. */
    GUARDIAN_FAILED,
};

/* Ends the connection to the guardian, and frees the struct. NULL is ignored. */
void guardian_end(Guardian *guardian, enum guardian_end how);

/* For a program that is about to make the rig safe itself: if a guardian is making the rig safe,
 * waits up to 5 s until it has ended. Returns whether the guardian is still working. */
gboolean guardian_await(const char *rig_path);

/* Starts a guardian for a rig without a daemon. The guardian makes the rig safe, and prints nothing
 * about a device that is made safe at the first attempt. */
void guardian_leave(const char *rig_path);

/* Runs the guardian. Its standard input is the socket to the daemon. Returns the exit code: 0 if
 * the rig is safe at the end, otherwise 1. */
int guardian_main(const char *rig_path);
