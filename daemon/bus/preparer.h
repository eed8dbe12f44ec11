/*
 * Work for clients that takes long or reads files they name: reading, planning and making sessions,
 * and examining those to be resumed. A child process with limits of time and memory does it; the
 * main loop, which controls lamps, lasers and axes, only waits for the answer.
 *
 * The child is the program mesorigd itself; it gets geometry and timing of the open rig, and opens
 * no device. Main loop's thread.
 */
#pragma once

#include "bus_caller.h"
#include "rig/devices.h"

enum preparer_task {
    PREPARER_CHECK,   /* capture_validate() */
    PREPARER_BEGIN,   /* capture_create() */
    PREPARER_EXAMINE, /* capture_examine() */
    PREPARER_TASKS,
};

struct preparer_limits {
    guint cpu_s, wall_s;
    guint64 memory_bytes; /* of address space, in addition to what the program itself takes */
};

/* Limits by task. They allow for examining the frames of a whole session. */
extern const struct preparer_limits preparer_default_limits[PREPARER_TASKS];

struct preparer_request {
    enum preparer_task task;
    struct preparer_limits limits;
    const struct devices *devices;
    const char *session_path; /* ignored by PREPARER_EXAMINE */
    const char *session_text; /* of that file; NULL: it is read */
    const char *directory;    /* empty: PREPARER_CHECK does without */
    const char *calibration;  /* replaces the calibration that the rig file names; NULL: that one */
    const char *chosen;       /* PREPARER_BEGIN: session_conf_choose(); NULL: nothing is auto */
    const char *calibration_text; /* of that file; NULL: it is read */
    const struct bus_caller
        *caller; /* who must have the right to write in directory; NULL: need not */
};

/* A child that is cancelled is killed. */
void preparer_run(const struct preparer_request *request, GCancellable *cancellable,
                  GAsyncReadyCallback callback, gpointer data);

/* PREPARER_CHECK: the plan's report (report.h). PREPARER_EXAMINE: a string, empty or a warning for
 * capture_go_on(). PREPARER_BEGIN: an empty string. g_variant_unref(). Errors are the task's own,
 * or BUS_ERROR_LIMIT. */
GVariant *preparer_finish(GAsyncResult *result, GError **error);

/* Runs as the child: reads a request from standard input and writes an answer to standard output.
 * Returns main()'s result. */
int preparer_child(void);
