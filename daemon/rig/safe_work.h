/*
 * Makes all devices of a rig safe. A device that fails is tried again, with pauses that grow from
 * 100 ms to 500 ms, for some seconds or until it is safe.
 *
 * Each line has a process of its own, so that a driver that hangs or crashes delays no other line.
 * A process works for a limited time; then another one takes its place.
 *
 * A SafeWork belongs to one thread, and the process must have no other threads. While it exists, it
 * waits for its own children only.
 */
#pragma once

#include "safe_state.h"

#include <poll.h>

typedef struct SafeWork SafeWork;

enum safe_until {
    SAFE_UNTIL_TIRED,        /* until 5 s have passed; says of each device what has come of it */
    SAFE_UNTIL_SAFE,         /* until every device is safe */
    SAFE_UNTIL_SAFE_QUIETLY, /* the same, but says nothing of a device that never failed */
};

/* SAFE_UNTIL_TIRED prints to standard output. The others print to standard error, and also to the
 * system's log unless standard error is the journal: when a device fails for the first time, when
 * it is safe, and every repeat_s while it is not. */
SafeWork *safe_work_new(const SafeState *state, enum safe_until until, double repeat_s);

/* Ends the processes, whatever has been done. NULL is ignored. */
void safe_work_free(SafeWork *work);

/* Goes on with the work until one of the n descriptors in more is ready (poll(2)), wait_ms have
 * passed (-1: no limit) or the work has ended. Returns whether the work goes on. */
gboolean safe_work_run(SafeWork *work, struct pollfd *more, int n, int wait_ms);

/* After the end: whether every device was read back and is safe. */
gboolean safe_work_is_safe(const SafeWork *work);

/* What is known of the devices that are not safe yet, with "; " between them; g_free(). */
char *safe_work_unsafe(const SafeWork *work);

/* SAFE_UNTIL_TIRED from beginning to end. TRUE if every device was read back and is safe. */
gboolean safe_work_once(const SafeState *state);
