/* A session that is being captured: the devices, the session directory, the sequencer and the
 * intake. The bus shows its state, and the commands control it. Main loop's thread.
 *
 * The sequencer (sequencer.c) moves axes, switches lights and triggers cameras. The intake
 * (intake.c) takes accepted frames in one worker lane per camera. It merges brackets to linear
 * radiance, evaluates sweeps, and returns the frames that are to be committed. Any fault makes the
 * rig safe and pauses the session with the reason. Everything that was committed stays.
 * capture_continue(), or capture_go_on() in a later run, continues the session.
 *
 * A laser may be mounted by hand at several places. Before the first sweep from another place, the
 * session is paused with a prompt until capture_continue() confirms the mounting. The session
 * stores the place of each unit. At the beginning the places are not known, so that the prompt
 * comes before anything moves. */
#pragma once

#include "plan/plan.h"
#include "rig/devices.h"
#include "thumbnail.h"

typedef struct Capture Capture;

enum capture_state {
    CAPTURE_HOMING,
    CAPTURE_RUNNING,
    CAPTURE_PAUSING, /* the shot under way is being finished */
    CAPTURE_PAUSED,  /* paused by the user, or by the fault that reason names; the rig is safe */
    CAPTURE_DONE,
    CAPTURE_ABORTED,
};

/* Whether another session on the same rig may succeed after this fault. */
enum capture_fault {
    CAPTURE_FAULT_NONE,
    /* a camera's pictures were refused too often, a lamp gave no light, or a frame that decides
     * which shots come next is damaged */
    CAPTURE_FAULT_SESSION,
    /* a fault of an interlock, axis or laser, a device that is gone, something that has moved, or a
     * full or failing disk */
    CAPTURE_FAULT_RIG,
};

struct capture_status {
    enum capture_state state;
    enum capture_fault fault; /* the fault that caused a pause */
    const char *reason;       /* the reason for a pause; NULL otherwise */
    /* the reason for a pause if the user must do something; NULL otherwise */
    const char *prompt;
    const char *doing; /* the current activity in a few words, for people */
    /* The shot that is being taken, or the last one that was taken. NULL before the first shot.
     * Valid until control returns to the main loop. */
    const struct session_shot *shot;
    int shots, shots_done;    /* of the whole session, including the shots before a resume */
    gint64 frames, retakes;   /* camera frames accepted and refused since started */
    double elapsed_s, left_s; /* on the rig's clock; left_s is predicted */
    guint64 bytes_stored;     /* frames and their rows on disk, including those of earlier runs */
    /* of the whole session: the plan's estimate, corrected by the frames stored so far */
    guint64 bytes_expected;
    double predicted_s, lower_bound_s;
};

struct capture_callbacks {
    void (*changed)(Capture *capture, gpointer data); /* called at most every 100 ms of real time */
    void (*event)(Capture *capture, const char *level, const char *source, const char *message,
                  gpointer data);
    gpointer data;
};

/* Checks everything that a capture would refuse (session against rig, free disk space, blocked
 * poses) without moving an axis. Returns the plan on success; free it with plan_free(). */
struct plan *capture_validate(const struct devices *devices, const struct session_conf *conf,
                              const char *directory, GError **error);

/* Makes the session directory with the plan and the calibration in it. If exposures were auto, the
 * session's value "chosen" says which exposures were chosen. Uses only the geometry, the timing and
 * the texts in devices, so that a process without open devices can call it (preparer.h). */
gboolean capture_create(const struct devices *devices, const struct session_conf *conf,
                        const char *directory, GError **error);

/* Starts the session that capture_create() has made. Borrows devices. */
Capture *capture_begin(struct devices *devices, const char *directory,
                       const struct capture_callbacks *callbacks, GError **error);

/* Checks whether a session directory can be resumed. Compares its frames with their rows, and plans
 * lost frames again. ret_warning is a warning for the event log, or NULL; g_free(). Uses devices as
 * capture_create() does. */
gboolean capture_examine(const struct devices *devices, const char *directory, char **ret_warning,
                         GError **error);

/* Continues a session that capture_examine() has accepted. Takes exactly the frames that are
 * missing. */
Capture *capture_go_on(struct devices *devices, const char *directory, const char *warning,
                       const struct capture_callbacks *callbacks, GError **error);

/* Makes the rig safe and closes the session. NULL is ignored. */
void capture_free(Capture *capture);

void capture_pause(Capture *capture); /* pauses after the shot under way */
gboolean capture_continue(Capture *capture, GError **error);
/* stops immediately; the session can still be resumed later */
void capture_abort(Capture *capture);

void capture_get_status(Capture *capture, struct capture_status *ret);

/* Returns the latest picture of a camera, scaled so that the 99th percentile is white. Returns NULL
 * before the first picture. The capture owns it. Valid until control returns to the main loop. */
const struct capture_thumbnail *capture_thumbnail(Capture *capture, int camera);
