/* Shows the progress of a capture of a daemon until the capture ends. */
#pragma once

#include "link.h"
#include "record.h"

enum monitor_end {
    MONITOR_DONE,
    MONITOR_FAULT,  /* paused by a fault; monitor_reason() says so if a device is not safe */
    MONITOR_PAUSED, /* paused by Ctrl-C in this program */
    /* Aborted by a second Ctrl-C in this program or by somebody else, or ended because the rig was
     * closed. */
    MONITOR_ABORTED,
    MONITOR_DETACHED, /* Ctrl-C was pressed; the capture continues without this program */
    MONITOR_LOST,     /* the daemon has exited or cannot be reached */
};

typedef struct Monitor Monitor;

/* Creates a monitor of the daemon of link, which is borrowed. If control is TRUE, the first Ctrl-C
 * pauses the capture after the shot under way, and the second aborts it. Otherwise Ctrl-C only ends
 * the watching. Create the monitor before a capture is started, so that no event is missed. */
Monitor *monitor_new(Link *link, gboolean control);
void monitor_free(Monitor *monitor);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Monitor, monitor_free)

/* Makes the monitor also show the pose and, if pictures is TRUE, the cameras' last pictures
 * (watching.h). */
void monitor_watch(Monitor *monitor, gboolean pictures);

/* Hides events of level "info" from this source, because the user already knows what they say. */
void monitor_leave_out(Monitor *monitor, const char *source);

enum monitor_answer {
    ANSWER_ELSEWHERE, /* “mesorig continue” in another terminal */
    /* “mesorig continue”, or the Enter key of this terminal if there is a terminal */
    ANSWER_ENTER,
    ANSWER_AT_ONCE, /* this program confirms the step immediately, for simulated rigs */
};

/* Sets who answers when the rig asks for a manual step. The default is ANSWER_ELSEWHERE. */
void monitor_set_answer(Monitor *monitor, enum monitor_answer answer);

/* Runs the main loop until one of the following happens:
 * - the capture ends,
 * - a fault pauses it, unless patient is TRUE,
 * - Ctrl-C pauses it, or leaves it running,
 * - the daemon is lost.
 *
 * If patient is TRUE, somebody may repair the rig after a fault and continue the capture. */
enum monitor_end monitor_run(Monitor *monitor, gboolean patient);

/* Runs the main loop until the daemon no longer processes the session in directory. Ctrl-C ends the
 * waiting, not the processing. Returns one of:
 * - MONITOR_DONE,
 * - MONITOR_FAULT if the processing has failed,
 * - MONITOR_DETACHED after Ctrl-C,
 * - MONITOR_LOST. */
enum monitor_end monitor_run_processing(Monitor *monitor, const char *directory);

/* Returns the reason for the pause, or "" if there was none; owned by the monitor. */
const char *monitor_reason(const Monitor *monitor);

/* Returns a text such as "3340 of 3340 shots, 51234 camera frames in this run, no retakes, 2 h 48
 * min simulated in 3 min 02 s". Free it with g_free(). */
char *monitor_summary(const Monitor *monitor);

/* Adds the daemon's state as values, without a text. */
void monitor_status(Record *to, BusRig1 *rig);
