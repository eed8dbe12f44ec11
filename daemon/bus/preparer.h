/*
 * Work for clients that takes long or reads files that clients name: reading, planning and making
 * sessions, and examining sessions that are to be resumed. A child process with limits of time and
 * memory does this work. The main loop controls lamps, lasers and axes, and does not wait for the
 * child.
 *
 * The child is the program mesorigd itself. It receives the geometry and the timing of the open
 * rig, and opens no device. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_caller.h"
#include "rig/devices.h"

#include <gio/gio.h>

enum preparer_task {
    PREPARER_CHECK,   /* capture_validate() */
    PREPARER_BEGIN,   /* capture_create() */
    PREPARER_EXAMINE, /* capture_examine() */
    PREPARER_TASKS,
};

struct preparer_limits {
    guint cpu_s, wall_s;
    /* limit of the address space in bytes, in addition to what the program itself needs */
    guint64 memory_bytes;
};

/* Limits for each task. Those of PREPARER_EXAMINE suffice to examine the frames of a whole
 * session. */
extern const struct preparer_limits preparer_default_limits[PREPARER_TASKS];

struct preparer_request {
    enum preparer_task task;
    struct preparer_limits limits;
    const struct devices *devices;
    const char *session_path; /* ignored by PREPARER_EXAMINE */
    const char *session_text; /* contents of the session file; NULL if the child has to read it */
    const char *directory;    /* may be empty with PREPARER_CHECK */
    /* Path of a calibration that replaces the one that the rig file names. If NULL, the calibration
     * that the rig file names is used. */
    const char *calibration;
    /* Only for PREPARER_BEGIN: lines for session_conf_choose(); NULL if no exposure is "auto". */
    const char *chosen;
    /* contents of the calibration; NULL if the child has to read it */
    const char *calibration_text;
    /* The user who must have the right to write in directory; NULL if the right is not checked. */
    const struct bus_caller *caller;
};

/* Starts the work. request is used only during this call. callback must pass its result to
 * preparer_finish(). If cancellable is cancelled, the child is killed. */
void preparer_run(const struct preparer_request *request, GCancellable *cancellable,
                  GAsyncReadyCallback callback, gpointer data);

/* Returns the result of a task, to be freed with g_variant_unref():
 * - PREPARER_CHECK: the report of the plan (report.h),
 * - PREPARER_EXAMINE: a string, which is a warning for capture_go_on() or empty,
 * - PREPARER_BEGIN: an empty string.
 *
 * Returns NULL with an error on failure. The error is that of the task, that of starting the child,
 * or one of these:
 * - BUS_ERROR_LIMIT if the child needed too much time or memory,
 * - BUS_ERROR_FAILED if the child gave no answer,
 * - G_IO_ERROR_CANCELLED. */
GVariant *preparer_finish(GAsyncResult *result, GError **error);

/* Runs as the child: reads a request from standard input and writes an answer to standard output.
 * Returns the exit code. It is 0 if an answer was written, even if the answer is an error,
 * otherwise 1. */
int preparer_child(void);
