/*
 * Chooses the laser sweeps that join a further round of a session with [lasers] stop = covered. The
 * choice depends on the part of the surface that the sweeps taken so far have measured
 * (selection/coverage_view.h). All functions but sweeps_choose() belong to the main loop's thread.
 */
#pragma once

#include "plan/plan.h"
#include "readers.h"

typedef struct Sweeps Sweeps;

/* All arguments are borrowed. Only the states of the shots may change. rig is calibrated. */
Sweeps *sweeps_new(Session *session, const struct session_conf *conf, const GPtrArray *shots,
                   const struct rig *rig, Readers *readers);
void sweeps_free(Sweeps *sweeps); /* call readers_free() before; NULL is ignored */

/* To be called when a sweep was committed. A thread of the readers examines its frames. */
void sweeps_take(Sweeps *sweeps, const struct session_shot *shot,
                 const struct session_frame *frames, int n);

/* To be called before sweeps_choose(). Records which sweeps are done or skipped. */
void sweeps_note_done(Sweeps *sweeps);

struct sweeps_choice {
    GArray *shots; /* of int: indices of the chosen shots; owned by the caller */
    /* the values of ADAPTIVE_KNOWN_PCT and ADAPTIVE_WORST_PCT (adaptive.h) */
    double known_pct, worst_pct;
};
/* Any thread may call sweeps_choose() while the readers have no jobs and the main loop calls no
 * function of this header. */
struct sweeps_choice sweeps_choose(const Sweeps *sweeps);
