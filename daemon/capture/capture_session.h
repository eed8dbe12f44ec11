/* The session that is being captured: the contents of its directory, its clock and its events. The
 * struct is owned by the Capture, and is used from capture_session_open() to
 * capture_session_close(). All functions belong to the main loop's thread.
 *
 * The parts of a capture borrow the struct. They may read all members, and write to the session
 * with the functions below. Only capture.c and capture_run.c change the state of a shot, n_shots
 * and n_done, and start the clock. */
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
    GPtrArray *shots;   /* all shots of the session, as struct session_shot */
    Adaptive *adaptive; /* chooses shots; NULL if all shots are taken */
    /* n_shots is the number of shots that will be taken, as far as it is known now. n_done is the
     * number of shots that are done. */
    int n_shots, n_done;
    struct run_clock clock;
    /* Called with each event that is added; may be NULL. */
    void (*event)(const char *level, const char *source, const char *message, gpointer data);
    gpointer event_data;
};

/* Opens a session directory for a capture. The session's clock has its stored value and is stopped.
 * Call capture_session_close() even if this function fails. */
gboolean capture_session_open(struct capture_session *session, struct devices *devices,
                              const char *directory, const struct adaptive_hooks *hooks,
                              GError **error);
/* Does nothing if the session is not open. */
void capture_session_close(struct capture_session *session);

/* Computes n_shots and n_done anew. Shots that were skipped, or that are not chosen yet, are not
 * counted. */
void capture_session_count(struct capture_session *session);

/* Returns whether a shot is chosen. In an adaptive capture, shots are chosen in rounds. Otherwise
 * all shots are chosen. */
gboolean capture_session_is_chosen(const struct capture_session *session,
                                   const struct session_shot *shot);

/* Returns the present value of the session's clock in seconds. */
double capture_session_now_s(const struct capture_session *session);

/* Adds an event to the session. Even if the event cannot be stored, it is passed to the function
 * `event`. */
void capture_session_add_event(const struct capture_session *session, const char *level,
                               const char *source, const char *message);

/* Reads a number from the session's values. Sets *ret to 0 if the session has no such value. If the
 * value exists but cannot be read, returns FALSE with an error. The caller must then not store
 * another number in place of the value. */
gboolean capture_session_load(const struct capture_session *session, const char *key, double *ret,
                              GError **error);
/* Stores a number as a value of the session. Errors are ignored. */
void capture_session_save(Session *store, const char *key, double value);
