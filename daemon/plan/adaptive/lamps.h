/*
 * The lamps' shots of a session with [lights] sampling = adaptive: which join a further round, by
 * how well the pictures that are not taken can be predicted from those that are
 * (prediction/prediction.h).
 *
 * Of each frame that is committed some hundred texels, the probes, are rectified and made
 * reflectances as the BTF has them. The predictor is made of these. Those shots are chosen that
 * lower the expected error most for their price (plan_lamp_prices_s()), until it is expected to be
 * below [lights] error_pct, [lights] budget_min is used up, or the round has as many shots as all
 * before it. Main loop's thread, but for lamps_choose().
 */
#pragma once

#include "calibration/calibration.h"
#include "plan/plan.h"
#include "readers.h"
#include "rounds.h"

typedef struct Lamps Lamps;

struct lamps_setup { /* all is borrowed, and stays as it is while it lives, but the shots' states */
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;
    const struct calibration *calibration; /* the session's */
    const struct rig *nominal;
    const struct rig_timing *timing;
    Readers *readers;
};

/* NULL: the session cannot be read. */
Lamps *lamps_new(const struct lamps_setup *setup, GError **error);
void lamps_dispose(Lamps *lamps); /* after the readers; NULL is ignored */
void lamps_stop(Lamps *lamps);    /* a choice under way ends soon, with G_IO_ERROR_CANCELLED */

/* A shot was committed: its frames are read in a reader's thread. */
void lamps_take_shot(Lamps *lamps, const struct session_shot *shot,
                     const struct session_frame *frames, int n);

/* Before lamps_choose(): which shots are done, and what the lamps gave in them. */
gboolean lamps_note_done(Lamps *lamps, GError **error);

enum lamps_end { LAMPS_GO_ON, LAMPS_KNOWN, LAMPS_BUDGET, LAMPS_ALL }; /* why there is no further */

struct lamps_choice {
    GArray *shots;               /* of int: numbers of shots, from 0; the caller's */
    double error_pct, after_pct; /* expected, now and after those shots */
    int n_taken, n_pictures;     /* of the BTF */
    enum lamps_end end;
};
/* In any thread, while the readers rest and the main loop calls nothing of this. rounds: those
 * before. The same measured values give the same choice. FALSE: cancelled. */
gboolean lamps_choose(Lamps *lamps, const struct rounds *rounds, struct lamps_choice *ret,
                      GError **error);
