/* The Capture puts together the parts of a capture. capture.c opens the session, returns its state
 * and carries out commands. capture_run.c takes the shots. Each part has its own header, and uses
 * only the other parts to which it gets a pointer. All functions belong to the main loop's
 * thread. */
#pragma once

#include "capture.h"
#include "capture_bytes.h"
#include "capture_lasers.h"
#include "capture_marks.h"
#include "capture_session.h"
#include "event_limit.h"
#include "flights.h"
#include "latest_picture.h"
#include "run_shots.h"
#include "run_totals.h"
#include "sequencer.h"
#include "time_left.h"

struct Capture {
    struct capture_callbacks callbacks;
    struct capture_session session;
    Intake *intake;
    Sequencer *sequencer;

    enum capture_state state;
    enum capture_fault fault; /* fault that caused the pause */
    char *reason, *doing;
    /* The sequencer has taken all shots that it was given (run_shots.h), or has paused. */
    gboolean all_taken;
    gboolean finishing; /* capture_finish() was called, and waits for the shot under way */
    guint starter;      /* timer on the rig's clock that starts a run; 0 if there is none */
    guint changed_source;
    gint64 changed_at_us;

    /* the run */
    struct run_shots run;
    struct flights flights;
    struct run_totals totals;
    struct time_left time_left;
    struct event_limit retake_limits[RIG_MAX_CAMERAS], saturated_limits[RIG_MAX_CAMERAS];

    /* what is known about the rig and the sample */
    struct capture_mounts mounts;
    struct capture_lasers lasers;
    struct capture_marks marks;
    struct capture_bytes bytes;
    struct latest_picture latest[RIG_MAX_CAMERAS];
};

extern const struct intake_hooks capture_intake_hooks;
extern const struct adaptive_hooks capture_adaptive_hooks;
extern const struct sequencer_hooks capture_sequencer_hooks;

/* Starts taking the remaining shots, from the main loop. */
void capture_begin_soon(Capture *capture);

/* Leaves out the remaining shots and ends the run. The rig must be safe. */
void capture_finish_now(Capture *capture);

/* Pauses the capture because the user has requested it. If capture_finish() was called, ends the
 * session instead. */
void capture_rest_for_user(Capture *capture);

/* capture_pause_for() drops the frames in flight (flights.h), stores the reason and pauses.
 * capture_come_to_rest() ends a run: it stops the session's clock and stores the totals and the
 * state. Before a call of these two functions, the rig must be safe or must have been commanded to
 * the safe state.
 *
 * capture_set_state() changes and stores only the state. capture_drop_flights() drops only the
 * frames in flight. */
void capture_pause_for(Capture *capture, enum capture_fault fault, const char *source,
                       const char *reason);
void capture_come_to_rest(Capture *capture, enum capture_state state);
void capture_set_state(Capture *capture, enum capture_state state);
void capture_drop_flights(Capture *capture);
