/*
 * Chooses the shots of lamps that join a further round of a session with [lights] sampling =
 * adaptive. The choice depends on how well the pictures that are not taken can be predicted from
 * the pictures that are taken (selection/prediction.h).
 *
 * Some hundred texels of each committed frame, the probes, are rectified and converted to
 * reflectances as in the BTF. The predictor uses these values. Shots are chosen one after the
 * other. The next one is always the shot that lowers the expected error most for its price
 * (plan_lamp_prices_s()). The round is complete when one of these is true:
 * - The error is expected to be below [lights] error_pct.
 * - [lights] budget_min is used up.
 * - The round has as many shots as all earlier rounds together.
 *
 * All functions but lamps_choose() belong to the main loop's thread.
 */
#pragma once

#include "calibration/calibration.h"
#include "plan/plan.h"
#include "readers.h"
#include "rounds.h"

typedef struct Lamps Lamps;

struct lamps_setup { /* borrowed; only the states of the shots may change */
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;
    const struct calibration *calibration; /* of the session */
    const struct rig *nominal;
    const struct rig_timing *timing;
    Readers *readers;
};

/* Returns NULL if the session cannot be read. */
Lamps *lamps_new(const struct lamps_setup *setup, GError **error);
void lamps_dispose(Lamps *lamps); /* call readers_free() before; NULL is ignored */
/* cancels a choice that is under way, which then fails with G_IO_ERROR_CANCELLED */
void lamps_stop(Lamps *lamps);

/* To be called when a shot was committed. A thread of the readers reads its frames. */
void lamps_take_shot(Lamps *lamps, const struct session_shot *shot,
                     const struct session_frame *frames, int n);

/* To be called before lamps_choose(). Records which shots are done, and reads the light output of
 * the lamps in these shots. Returns FALSE with an error if the session cannot be read. */
gboolean lamps_note_done(Lamps *lamps, GError **error);

/* Whether there is a further round, and why not:
 * - LAMPS_GO_ON: there is a further round.
 * - LAMPS_KNOWN: there is none, because the error is small enough.
 * - LAMPS_BUDGET: there is none, because the budget has no time for a further shot.
 * - LAMPS_ALL: there is none, because no shot is left. */
enum lamps_end { LAMPS_GO_ON, LAMPS_KNOWN, LAMPS_BUDGET, LAMPS_ALL };

struct lamps_choice {
    /* of int: indices of the chosen shots in setup.shots; owned by the caller */
    GArray *shots;
    double error_pct, after_pct; /* expected error in %: now, and after the chosen shots */
    int n_taken, n_pictures;     /* pictures of the BTF: those that are taken, and all */
    enum lamps_end end;
};
/* Any thread may call lamps_choose() while the readers have no jobs and the main loop calls no
 * function of this header. rounds contains the earlier rounds. The same measured values give the
 * same choice. Returns FALSE with an error if the choice was cancelled or failed. */
gboolean lamps_choose(Lamps *lamps, const struct rounds *rounds, struct lamps_choice *ret,
                      GError **error);
