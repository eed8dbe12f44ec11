/*
 * A session being captured: devices, session directory, sequencer and intake together. The bus
 * shows it, and the commands control it. Main loop's thread.
 *
 * The sequencer (sequencer.c) moves, switches and triggers; the intake (intake.c) takes accepted
 * frames, merges brackets to linear radiance and feeds sweeps in one worker lane per camera, and
 * hands back what is to be committed. Any fault makes the rig safe and pauses the session with the
 * reason; everything committed stays, and capture_continue() or a later capture_resume() goes on.
 *
 * Before the first sweep from another place of a laser that is mounted by hand, the session is
 * paused with a prompt until capture_continue() confirms the mounting. The session stores where
 * each unit is. At the beginning that is not known: the prompt comes before anything moves.
 */
#pragma once

#include "plan/plan.h"
#include "rig/devices.h"

typedef struct Capture Capture;

enum capture_state {
    CAPTURE_HOMING,
    CAPTURE_RUNNING,
    CAPTURE_PAUSING, /* finishing what is under way */
    CAPTURE_PAUSED,  /* by the user, or by a fault: see reason; the rig is safe */
    CAPTURE_DONE,
    CAPTURE_ABORTED,
};

/* Whether another session on the same rig can be expected to do better. */
enum capture_fault {
    CAPTURE_FAULT_NONE,
    CAPTURE_FAULT_SESSION, /* a camera's pictures were refused too often, a lamp gave no light, or a
                              frame that tells which shots come next is damaged */
    CAPTURE_FAULT_RIG,     /* an interlock, axis or laser, a device that is gone, something that has
                              moved, the disk */
};

struct capture_status {
    enum capture_state state;
    enum capture_fault fault; /* of a pause */
    const char *reason;       /* of a pause; NULL otherwise */
    const char *prompt;       /* the same, if it asks for something to be done; else NULL */
    const char *doing;        /* in a few words, for people */
    /* That is taken, or was taken last; NULL: none yet. Until the main loop runs. */
    const struct session_shot *shot;
    int shots, shots_done;    /* of the whole session, those from before a resume counted */
    gint64 frames, retakes;   /* camera frames accepted and refused since started */
    double elapsed_s, left_s; /* on the rig's clock; left_s predicted */
    guint64 bytes_stored;     /* on disk, frames and their rows; earlier runs counted */
    guint64 bytes_expected;   /* of the whole session, as planned and then by what is stored */
    double predicted_s, lower_bound_s;
};

struct capture_thumbnail {
    int width, height;
    guint8 *rgb; /* width × height × 3 */
    double time_s;
};

struct capture_callbacks {
    void (*changed)(Capture *capture, gpointer data); /* at most every 100 ms of real time */
    void (*event)(Capture *capture, const char *level, const char *source, const char *message,
                  gpointer data);
    gpointer data;
};

/* Checks everything (session against rig, free disk, blocked poses) without moving: what a capture
 * would refuse. The plan is returned on success; free with plan_free(). */
struct plan *capture_validate(const struct devices *devices, const struct session_conf *conf,
                              const char *directory, GError **error);

/* Makes the session directory, with the plan and the calibration in it; of exposures that were auto
 * the session's value "chosen" says which were chosen. Uses only the geometry,
 * timing and texts in devices: a process without open devices can do it (preparer.h). */
gboolean capture_create(const struct devices *devices, const struct session_conf *conf,
                        const char *directory, GError **error);

/* Starts with what capture_create() has made. Borrows devices. */
Capture *capture_begin(struct devices *devices, const char *directory,
                       const struct capture_callbacks *callbacks, GError **error);

/* Checks whether a session directory can be resumed: compares its frames with their rows, and plans
 * lost ones again. ret_warning: a warning for the event log, or NULL; g_free(). Uses devices as
 * capture_create() does. */
gboolean capture_examine(const struct devices *devices, const char *directory, char **ret_warning,
                         GError **error);

/* Goes on with what capture_examine() has found good; takes exactly what is missing. */
Capture *capture_go_on(struct devices *devices, const char *directory, const char *warning,
                       const struct capture_callbacks *callbacks, GError **error);

/* Both steps in one process. */
Capture *capture_start(struct devices *devices, const struct session_conf *conf,
                       const char *directory, const struct capture_callbacks *callbacks,
                       GError **error);
Capture *capture_resume(struct devices *devices, const char *directory,
                        const struct capture_callbacks *callbacks, GError **error);

/* Makes the rig safe and closes the session. NULL is ignored. */
void capture_free(Capture *capture);

void capture_pause(Capture *capture); /* after the shot under way */
gboolean capture_continue(Capture *capture, GError **error);
void capture_abort(Capture *capture); /* now; the session can still be resumed later */

void capture_get_status(Capture *capture, struct capture_status *ret);

/* The latest picture of a camera, white at the 99th percentile; NULL before the first. */
const struct capture_thumbnail *capture_thumbnail(Capture *capture, int camera);
