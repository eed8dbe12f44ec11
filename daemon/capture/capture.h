/* A session that is being captured: the devices, the session directory, the sequencer and the
 * intake. The bus shows its state, and the commands control it. All functions belong to the main
 * loop's thread.
 *
 * The sequencer (sequencer.c) moves axes, switches lights and triggers cameras. The intake
 * (intake.c) processes the accepted frames of each camera in a separate worker thread: it merges
 * brackets to linear radiance and evaluates sweeps. Its results are stored in the session.
 *
 * Any fault makes the rig safe and pauses the session with the reason. All frames that were stored
 * before the fault are kept. The session is continued by capture_continue() or, in a later run, by
 * capture_go_on().
 *
 * A laser may be mounted by hand at several places. Before the first sweep from another place, the
 * session is paused with a prompt until capture_continue() confirms the mounting. The session
 * stores the place of each laser unit. In a new session the places are not known, so the session
 * asks for the mounting before it takes any shot. */
#pragma once

#include "plan/plan.h"
#include "rig/devices.h"
#include "thumbnail.h"

typedef struct Capture Capture;

enum capture_state {
    CAPTURE_HOMING,
    CAPTURE_RUNNING,
    CAPTURE_PAUSING, /* the shot under way is being finished */
    CAPTURE_PAUSED,  /* `reason` says why; the rig is safe unless `reason` says otherwise */
    CAPTURE_DONE,
    CAPTURE_ABORTED,
};

/* Kinds of faults. After CAPTURE_FAULT_SESSION, another session on the same rig may succeed. After
 * CAPTURE_FAULT_RIG, no session will succeed until the rig has been repaired. */
enum capture_fault {
    CAPTURE_FAULT_NONE,
    /* A camera's pictures were refused too often, a lamp gave no light, or a frame that decides
     * which shots come next is damaged. */
    CAPTURE_FAULT_SESSION,
    /* An interlock, axis or laser has a fault, a device does not respond, something has moved, or
     * the disk is full or fails. */
    CAPTURE_FAULT_RIG,
};

struct capture_status {
    enum capture_state state;
    enum capture_fault fault; /* the fault that caused a pause */
    const char *reason;       /* the reason for a pause; NULL otherwise */
    /* Text that asks the user to mount a laser by hand, if the session is paused for this; NULL
     * otherwise. */
    const char *prompt;
    const char *doing; /* the current activity in a few words, for people */
    /* The shot that is being taken, or the last one that was taken. NULL before the first shot.
     * Valid until control returns to the main loop. */
    const struct session_shot *shot;
    /* Numbers of shots of the whole session, and of shots that are done. Both include earlier
     * runs. */
    int shots, shots_done;
    /* Numbers of camera frames in this run: frames that were accepted, and frames that were refused
     * and taken again. */
    gint64 frames, retakes;
    /* Times on the rig's clock, in seconds. elapsed_s is the time for which the session was
     * captured, without pauses. left_s is the predicted time until the session is complete. */
    double elapsed_s, left_s;
    /* Size in bytes of the stored frames and of their rows in the database, including earlier
     * runs. */
    guint64 bytes_stored;
    /* Expected size of the whole session in bytes. It is the plan's estimate, corrected by the
     * frames stored so far. */
    guint64 bytes_expected;
    double predicted_s, lower_bound_s;
};

struct capture_callbacks {
    void (*changed)(Capture *capture, gpointer data); /* called at most every 100 ms of real time */
    void (*event)(Capture *capture, const char *level, const char *source, const char *message,
                  gpointer data);
    gpointer data;
};

/* Checks everything for which a capture would be refused, without moving an axis:
 * - the session does not fit the rig,
 * - the directory exists already,
 * - the disk has too little space,
 * - a pose is blocked.
 *
 * directory may be NULL; directory and disk are then not checked. Returns the plan on success, to
 * be freed with plan_free(). Otherwise returns NULL with an error. */
struct plan *capture_validate(const struct devices *devices, const struct session_conf *conf,
                              const char *directory, GError **error);

/* Makes the session directory, with the plan and the calibration in it. If exposures were "auto",
 * the session's value "chosen" says which exposures were chosen. Of `devices`, only the geometry,
 * the timing and the texts are used. A process without open devices can therefore call this
 * function (preparer.h). */
gboolean capture_create(const struct devices *devices, const struct session_conf *conf,
                        const char *directory, GError **error);

/* Starts the session that capture_create() has made. devices is borrowed. Returns NULL with an
 * error if the session cannot be opened. Free the result with capture_free(). */
Capture *capture_begin(struct devices *devices, const char *directory,
                       const struct capture_callbacks *callbacks, GError **error);

/* Checks whether the session in a directory can be resumed. Compares its stored frames with their
 * rows in the database, and plans the shots of lost frames again. Returns FALSE with an error if
 * the session cannot be resumed. *ret_warning is a warning for the event log, to be freed with
 * g_free(), or NULL. `devices` is used as in capture_create(). */
gboolean capture_examine(const struct devices *devices, const char *directory, char **ret_warning,
                         GError **error);

/* Continues a session that capture_examine() has accepted, and takes only the missing shots.
 * warning is the warning of capture_examine(), or NULL. Everything else is as for
 * capture_begin(). */
Capture *capture_go_on(struct devices *devices, const char *directory, const char *warning,
                       const struct capture_callbacks *callbacks, GError **error);

/* Makes the rig safe and closes the session. NULL is ignored. */
void capture_free(Capture *capture);

void capture_pause(Capture *capture); /* pauses after the shot under way */
/* Continues a paused session. If a prompt has asked for a mounting, the call confirms this
 * mounting. Returns FALSE with an error if the session is not paused, if an interlock is open, or
 * if the mounting cannot be stored. */
gboolean capture_continue(Capture *capture, GError **error);
/* Ends the session as good enough, after the shot under way. A paused session ends immediately. The
 * shots that are not done are left out (SESSION_LEFT_OUT), and the state becomes CAPTURE_DONE. If
 * the daemon is killed before all of them are left out, a later run leaves out the others. Returns
 * FALSE with an error if the session has already ended. */
gboolean capture_finish(Capture *capture, GError **error);
/* Name of the session's value that capture_finish() sets. The value is the note of the shots that
 * are left out. */
#define CAPTURE_FINISHED_KEY "finished"
/* Stops immediately. The session can still be resumed later. */
void capture_abort(Capture *capture);

void capture_get_status(Capture *capture, struct capture_status *ret);

/* Returns the thumbnail of a camera's latest picture, scaled so that the 99th percentile is white.
 * Returns NULL before the first picture. The capture owns the thumbnail. It is valid until control
 * returns to the main loop. */
const struct capture_thumbnail *capture_thumbnail(Capture *capture, int camera);
/* Returns the time of a camera's latest picture in seconds on the session's clock, or −1 before the
 * first picture. Unlike capture_thumbnail(), it does not make the thumbnail, which takes long for a
 * large picture. */
double capture_picture_time_s(const Capture *capture, int camera);
