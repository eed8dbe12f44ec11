/*
 * The capture that is under way. After it has ended, its last state and its last pictures are kept
 * here. The struct is owned by the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_hands.h"
#include "capture/capture.h"
#include "capture/followers.h"

/* Functions that are called in the main loop's thread with the member `data`. */
struct bus_run_hooks {
    void (*begun)(gpointer data);
    void (*changed)(const struct capture_status *status, gpointer data);
    void (*ended)(gpointer data); /* the capture has ended and released the session */
    void (*shown)(gpointer data); /* the state that clients see has changed */
    gpointer data;
};

struct bus_run {
    struct bus_rig *rig;     /* borrowed; this module sets rig->captured */
    struct bus_hands *hands; /* borrowed */
    const char *address;     /* address by which clients reach the daemon; borrowed */
    struct bus_run_hooks hooks;
    Capture *capture; /* NULL if no capture is running or paused */
    char *directory;  /* directory of the session that is or was captured */
    /* processing of sessions during and after their capture (followers.h); NULL before the first
     * one */
    Followers *followers;
    /* Monotonic time at which the capture began or last homed its axes, in µs. */
    gint64 started_us;
    double started_elapsed_s; /* elapsed_s of the capture (capture.h) at started_us */
    guint tick_id;            /* timer that shows the time during a capture */
    guint end_id;             /* the idle source that frees a capture that has ended */
    double thumbnail_time_s[RIG_MAX_CAMERAS];
    gint64 thumbnail_sent_us[RIG_MAX_CAMERAS];
    /* The last pictures of a capture that has ended. */
    struct capture_thumbnail kept[RIG_MAX_CAMERAS];
};

/* Returns whether a capture is under way. If not, the error is BUS_ERROR_NO_SESSION. */
gboolean bus_run_need(const struct bus_run *run, GError **error);

/* Captures into a session directory. If resumed is FALSE, a job has made the directory
 * (PREPARER_BEGIN). If resumed is TRUE, a job has examined it (PREPARER_EXAMINE), and warning is
 * the answer of that job, or NULL if there is no warning. If process is TRUE, the session is
 * processed during the capture and after it, also while the next session is captured. Ends all use
 * of devices by hand.
 *
 * Returns FALSE with an error if the safe state is latched, if a device has not confirmed that it
 * is safe, or if capture_begin() or capture_go_on() fails. */
gboolean bus_run_begin(struct bus_run *run, const char *directory, gboolean resumed,
                       const char *warning, gboolean process, GError **error);

/* Ends the capture in its present state, so that it can be resumed. */
void bus_run_end(struct bus_run *run);

/* Ends the capture as bus_run_end() does, ends the processing of all sessions, and forgets
 * directory and pictures. */
void bus_run_close(struct bus_run *run);

/* Returns the last thumbnail of a camera. It is owned by run and valid until the main loop runs
 * again. Returns NULL with an error if no rig is open, the camera is unknown, nothing was captured,
 * or the camera has not taken a picture yet. */
const struct capture_thumbnail *bus_run_thumbnail(struct bus_run *run, const char *camera,
                                                  GError **error);
