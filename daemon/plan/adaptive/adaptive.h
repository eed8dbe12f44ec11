/*
 * Which of the planned shots are taken, in rounds: laser sweeps until the surface is known
 * ([lasers] stop = covered), and lamps until what they would show is known ([lights] sampling =
 * adaptive). One of them, or both, may be on; each chooses for itself, by its own frames.
 *
 * The first round has what plan_first_sweeps() and plan_first_lamps() chose from geometry only
 * when the session was planned.
 * Every frame is examined as it is committed (coverage/coverage_view.h; lamps.h). At the end of a
 * round:
 *
 * - Sweeps: for each turntable angle, the one that is expected to add most to what its cameras know
 *   joins the next round, and the next best after it, as long as they add at least [lasers] gain.
 *   When none does, those that are left are left out for good.
 * - Lamps: the pictures that are not taken are predicted (prediction/prediction.h), and shots join
 *   that lower the expected error most for their time. When it is expected to be below [lights]
 *   error_pct, or [lights] budget_min is used up, those that are left are left out for good.
 *
 * A choice is a function of the session's plan and of its files only, and is stored before it is
 * acted upon, so that a session that is killed and resumed goes on as if nothing had happened
 * (rounds.h): values "lasers.round.K" and "lights.round.K". Shots that are left out are skipped,
 * and their notes say why.
 *
 * Main loop's thread; files are read and choices made in threads of their own, for which the clock
 * is held. In lockstep (drivers/clock.h) the main loop waits for what reads a file.
 */
#pragma once

#include "calibration/calibration.h"
#include "drivers/clock.h"
#include "plan/plan.h"
#include "session/session.h"

typedef struct Adaptive Adaptive;

/* Values of the session: parts, in %, of the texels that the sweeps made known by the last round,
 * of all views and of that with the least. */
#define ADAPTIVE_KNOWN_PCT "lasers.known_pct"
#define ADAPTIVE_WORST_PCT "lasers.worst_pct"
/* The expected error after the last round of lamps, in %: root of the mean square over all values
 * of the BTF, relative to that of the values. Pictures that are taken count as known. */
#define ADAPTIVE_ERROR_PCT "lights.error_pct"
/* A round's value has its number, from 1, behind these. */
#define ADAPTIVE_LASER_ROUNDS "lasers.round."
#define ADAPTIVE_LIGHT_ROUNDS "lights.round."

struct adaptive_hooks {
    /* A round was chosen and stored; n: its shots; 0: nothing is left to be chosen, and the rest
     * has been left out. of_lasers, of_lights: what was found, for the session's events; NULL:
     * nothing was to be chosen of these. error: nothing was chosen; a file cannot be read, or the
     * session not be written. */
    void (*chosen)(int n, const char *of_lasers, const char *of_lights, const GError *error,
                   gpointer data);
    gpointer data;
};

struct adaptive_setup { /* all is borrowed as long as it lives */
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;    /* all of the session's; their states are read in the main loop */
    const struct rig *nominal; /* as the plan had it */
    const struct rig_timing *timing;
    const struct calibration *calibration; /* the session's */
    Clock *clock;
    struct adaptive_hooks hooks; /* copied */
};

/* Whether a session has rounds. */
gboolean adaptive_is_wanted(const struct session_conf *conf);

/* The value of the first round of sweeps or lamps (kind), which a session has from its beginning;
 * NULL: these do not come in rounds. g_free() */
char *adaptive_first_round(const struct session_conf *conf, const struct plan *plan,
                           enum session_shot_kind kind);

/* Frames that are there are examined from their files. NULL: the session cannot be read or written,
 * or its values are not as described above. */
Adaptive *adaptive_new(const struct adaptive_setup *setup, GError **error);
void adaptive_free(Adaptive *adaptive); /* NULL is ignored; no hook is called after it */

/* Whether a shot is in a round; those that do not come in rounds always are. */
gboolean adaptive_is_chosen(const Adaptive *adaptive, const struct session_shot *shot);

/* In which round a shot is, from 1; 0: in none yet. Shots that do not come in rounds are in the
 * first. */
int adaptive_round_of(const Adaptive *adaptive, const struct session_shot *shot);
int adaptive_rounds(const Adaptive *adaptive);

/* A shot was committed. */
void adaptive_take(Adaptive *adaptive, const struct session_shot *shot,
                   const struct session_frame *frames, int n);

/* Call it when all chosen shots are done. Answers by the hook, later. */
void adaptive_choose(Adaptive *adaptive);
/* There is nothing left to choose. */
gboolean adaptive_is_over(const Adaptive *adaptive);
