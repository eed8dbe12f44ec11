/*
 * The laser sweeps of a session with [lasers] stop = covered: which join a further round, by what
 * those taken so far know of the surface (coverage/coverage_view.h). Main loop's thread, but for
 * sweeps_choose().
 */
#pragma once

#include "plan/plan.h"
#include "readers.h"

typedef struct Sweeps Sweeps;

/* All but the readers are borrowed, and stay as they are while it lives, but for the shots' states;
 * rig: calibrated. */
Sweeps *sweeps_new(Session *session, const struct session_conf *conf, const GPtrArray *shots,
                   const struct rig *rig, Readers *readers);
void sweeps_free(Sweeps *sweeps); /* after the readers; NULL is ignored */

/* A sweep was committed: it is examined in a reader's thread. */
void sweeps_take(Sweeps *sweeps, const struct session_shot *shot,
                 const struct session_frame *frames, int n);

/* Before sweeps_choose(): which sweeps are done. */
void sweeps_note_done(Sweeps *sweeps);

struct sweeps_choice {
    GArray *shots; /* of int: numbers of shots, from 0; the caller's */
    double known_pct, worst_pct;
};
/* In any thread, while the readers rest and the main loop calls nothing of this. */
struct sweeps_choice sweeps_choose(const Sweeps *sweeps);
