/* The session that is being captured: the contents of its directory, its clock and its events.
 * Owned by the Capture, from capture_session_open() to capture_session_close(). The parts of a
 * capture borrow it. They may read all members, and write to the session with the functions below.
 * Only capture.c and capture_run.c change the state of a shot, n_shots and n_done, and start the
 * clock. Main loop's thread. */
#pragma once

#include "calibration/calibration.h"
#include "plan/adaptive/adaptive.h"
#include "rig/devices.h"
#include "run_clock.h"

struct capture_session {
    struct devices *devices; /* borrowed */
    Session *store;          /* the session directory */
    struct session_conf conf;
    struct calibration *calibration;
    GPtrArray *shots;   /* of struct session_shot: all shots of the session */
    Adaptive *adaptive; /* chooses shots; NULL if all shots are taken */
    /* n_shots is the number of shots that will be taken, as far as it is known. n_done is the
     * number of shots that are done. */
    int n_shots, n_done;
    struct run_clock clock;
    /* Receives each event that is added; may be NULL. */
    void (*event)(const char *level, const char *source, const char *message, gpointer data);
    gpointer event_data;
};

/* Opens a session directory for a capture. The session's clock is stopped at its stored value. Call
 * capture_session_close() even if this fails. */
gboolean capture_session_open(struct capture_session *session, struct devices *devices,
                              const char *directory, const struct adaptive_hooks *hooks,
                              GError **error);
/* Does nothing if the session is not open. */
void capture_session_close(struct capture_session *session);

/* Counts the shots anew. Skipped shots and shots that are not chosen yet are not counted. */
void capture_session_count(struct capture_session *session);

/* Returns whether an adaptive capture has chosen a shot. Without an adaptive capture, returns
 * TRUE. */
gboolean capture_session_is_chosen(const struct capture_session *session,
                                   const struct session_shot *shot);

/* Returns the present value of the session's clock in seconds. */
double capture_session_now_s(const struct capture_session *session);

/* Adds an event to the session, and passes it to the listener even if it could not be stored. */
void capture_session_add_event(const struct capture_session *session, const char *level,
                               const char *source, const char *message);

/* Reads a number among the session's values. Sets *ret to 0 if the value is not set. Returns FALSE
 * with an error if the value exists but cannot be read, so that the caller does not later store 0
 * instead of the value. */
gboolean capture_session_load(const struct capture_session *session, const char *key, double *ret,
                              GError **error);
/* Writes a number among the session's values. Errors are ignored. */
void capture_session_save(Session *store, const char *key, double value);
