/*
 * Chooses which of the planned shots are taken, in rounds. Laser sweeps are taken until the surface
 * is known ([lasers] stop = covered). Shots of lamps are taken until the remaining pictures can be
 * predicted ([lights] sampling = adaptive). Either or both may be on. The choice of sweeps depends
 * on the frames of sweeps only, and the choice of shots of lamps on the frames of lamps only.
 *
 * plan_first_sweeps() and plan_first_lamps() choose the first round from the geometry when the
 * session is planned. Every frame is examined when it is committed (selection/coverage_view.h,
 * lamps.h). At the end of a round:
 *
 * - Sweeps: at each turntable angle, up to two sweeps join the next round. These are the sweeps in
 *   which the cameras are expected to measure most texels that they have not measured yet. Each of
 *   them must add at least [lasers] gain_pct. When no sweep adds so much, the remaining sweeps are
 *   left out for good.
 * - Lamps: the pictures that are not taken are predicted (selection/prediction.h). The shots that
 *   lower the expected error most for their time join the next round. When the error is expected to
 *   be below [lights] error_pct, or [lights] budget_min is used up, the remaining shots are left
 *   out for good.
 *
 * A choice is a function of the session's plan and its files only. It is stored before it takes
 * effect (rounds.h), as the values "lasers.round.K" and "lights.round.K". A session that is killed
 * and resumed therefore makes the same choices. Shots that are left out are skipped, and their
 * notes say why.
 *
 * All functions belong to the main loop's thread. Other threads read files and make choices.
 * Virtual time stands still while a choice is made (clock_hold()). In lockstep (drivers/clock.h)
 * the main loop waits until each file is read.
 */
#pragma once

#include "calibration/calibration.h"
#include "drivers/clock.h"
#include "plan/plan.h"
#include "session/session.h"

typedef struct Adaptive Adaptive;

/* Values of the session: the percentage of texels that the sweeps so far have measured.
 * ADAPTIVE_KNOWN_PCT is the percentage over all views. ADAPTIVE_WORST_PCT is that of the view with
 * the smallest percentage. */
#define ADAPTIVE_KNOWN_PCT "lasers.known_pct"
#define ADAPTIVE_WORST_PCT "lasers.worst_pct"
/* Value of the session: the expected error after the last round of lamps, in %. It is the root mean
 * square error of all values of the BTF, relative to the root mean square of the values. Pictures
 * that are taken count as known. */
#define ADAPTIVE_ERROR_PCT "lights.error_pct"
/* Beginnings of the names of values that store a round. The number of the round follows, from 1. */
#define ADAPTIVE_LASER_ROUNDS "lasers.round."
#define ADAPTIVE_LIGHT_ROUNDS "lights.round."

struct adaptive_hooks {
    /* Called when a round of n shots was chosen and stored. If n is 0, nothing is left to choose,
     * and the remaining shots have been left out.
     *
     * of_lasers and of_lights describe the result for the session's events. Each is NULL if no
     * choice was made for this kind.
     *
     * If a file cannot be read or the session cannot be written, error is set and n is 0. */
    void (*chosen)(int n, const char *of_lasers, const char *of_lights, const GError *error,
                   gpointer data);
    gpointer data;
};

struct adaptive_setup { /* everything is borrowed by the Adaptive */
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;    /* all shots of the session; the main loop reads their states */
    const struct rig *nominal; /* the rig for which the session was planned */
    const struct rig_timing *timing;
    const struct calibration *calibration; /* of the session */
    Clock *clock;
    struct adaptive_hooks hooks; /* copied */
};

/* Returns whether a session file asks for rounds of sweeps or lamps. */
gboolean adaptive_is_wanted(const struct session_conf *conf);

/* Returns the session's value that stores the first round of sweeps or lamps (kind); g_free(). The
 * value is stored when the session is made. Returns NULL if this kind does not come in rounds. */
char *adaptive_first_round(const struct session_conf *conf, const struct plan *plan,
                           enum session_shot_kind kind);

/* Examines the frames that the session already has. Returns NULL with an error if the session
 * cannot be read or written, or if a stored value of a round is not valid. */
Adaptive *adaptive_new(const struct adaptive_setup *setup, GError **error);
void adaptive_free(Adaptive *adaptive); /* NULL is ignored; no hook is called after it */

/* Returns whether a shot is in a round so far. Returns TRUE for shots that do not come in
 * rounds. */
gboolean adaptive_is_chosen(const Adaptive *adaptive, const struct session_shot *shot);

/* Returns the number of the round of a shot, from 1, or 0 if the shot is in no round yet. Returns 1
 * for shots that do not come in rounds. adaptive_rounds() returns the number of rounds so far. */
int adaptive_round_of(const Adaptive *adaptive, const struct session_shot *shot);
int adaptive_rounds(const Adaptive *adaptive);

/* To be called when a shot was committed. frames has the n frames that the shot has stored. */
void adaptive_take(Adaptive *adaptive, const struct session_shot *shot,
                   const struct session_frame *frames, int n);

/* Chooses the next round. All chosen shots must be done. The hook gives the result later. */
void adaptive_choose(Adaptive *adaptive);
/* Returns whether nothing is left to choose. */
gboolean adaptive_is_over(const Adaptive *adaptive);
