/* Makes all devices of a rig safe. A device that fails is tried again, with pauses that grow from
 * 100 ms to 500 ms, for 5 s or until it is safe (enum safe_until).
 *
 * Each line of devices (safe_state_line()) has a child process, so that a driver that hangs or
 * crashes does not delay other lines. A process works for a limited time, and is then replaced by
 * another one.
 *
 * If the work may last longer than 5 s (not SAFE_UNTIL_TIRED), pipes at standard output and
 * standard error are closed after 5 s, in this process and in its children. The reader of a pipe
 * may wait until all writers have closed it.
 *
 * A SafeWork belongs to one thread, and the process must have no other threads. The process may
 * have other children: a SafeWork calls waitpid(2) only for those that it started. */
#pragma once

#include "safe_state.h"

#include <poll.h>

typedef struct SafeWork SafeWork;

enum safe_until {
    SAFE_UNTIL_TIRED, /* ends after 5 s; prints the result of each device */
    /* Ends when every device is safe, cannot be made safe, or is left to another mesorigd that has
     * had it open for repeat_s. */
    SAFE_UNTIL_SAFE,
    /* Ends like SAFE_UNTIL_SAFE; prints nothing about a device that is made safe at the first
     * attempt. */
    SAFE_UNTIL_SAFE_QUIETLY,
};

/* Begins the work. SAFE_UNTIL_TIRED prints to standard output. The other two print to standard
 * error and, if that is not the journal, also to the system's log. They print when a device fails
 * for the first time, when it is safe, and every repeat_s while it is not safe. */
SafeWork *safe_work_new(const SafeState *state, enum safe_until until, double repeat_s);

/* Ends the processes, even if the work is not finished. NULL is ignored. */
void safe_work_free(SafeWork *work);

/* Continues the work until one of the n descriptors in more is ready (poll(2)), wait_ms have passed
 * (-1 for no limit) or the work has ended. Returns whether work is left. */
gboolean safe_work_run(SafeWork *work, struct pollfd *more, int n, int wait_ms);

/* Returns whether every device has confirmed that it is safe (SAFE_TRY_SAFE), and the rig file
 * names at least one device. Call it when the work has ended. */
gboolean safe_work_is_safe(const SafeWork *work);

/* Returns the last result of each device that is not safe yet, or the device's name if it was
 * not tried yet, separated by "; ". Free it with g_free(). */
char *safe_work_unsafe(const SafeWork *work);

/* Does the whole work with SAFE_UNTIL_TIRED. Returns safe_work_is_safe(). *ret_hope is TRUE if
 * another attempt may make an unsafe device safe. */
gboolean safe_work_once(const SafeState *state, gboolean *ret_hope);
