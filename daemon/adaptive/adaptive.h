/*
 * Laser sweeps until the surface is known ([lasers] stop = covered): which of the planned sweeps
 * are taken, in rounds.
 *
 * The first round has the sweeps that plan_first_sweeps() chooses for each turntable angle from
 * geometry alone. Every sweep is examined as it is committed (coverage/coverage_view.h). At the end
 * of a round, for each turntable angle, the sweep that is expected to add most to what its cameras
 * know joins the next round, and the next best after it, as long as they add at least [lasers]
 * gain. When none does, those that are left are left out for good.
 *
 * A choice is a function of the session's plan and of its sweeps' files alone, and is stored before
 * it is acted upon, so that a session that is killed and resumed goes on as if nothing had
 * happened. The session's values "lasers.round.K" hold the shots that joined in round K, as
 * numbers with spaces between them, and one of them without any is the last. Shots that are left
 * out are skipped, and their notes say why.
 *
 * Main loop's thread; files are read and choices made in threads of their own, for which the clock
 * is held. In lockstep (drivers/clock.h) the main loop waits for what reads a file.
 */
#pragma once

#include "drivers/clock.h"
#include "geometry/rig.h"
#include "plan/plan.h"
#include "session/session.h"

typedef struct Adaptive Adaptive;

#define ADAPTIVE_LEFT_OUT "left out:" /* how the note of such a shot begins */
/* Values of the session: parts, in %, of the texels that the sweeps made known by the last round,
 * of all views and of that with the least. */
#define ADAPTIVE_KNOWN_PCT "lasers.known_pct"
#define ADAPTIVE_WORST_PCT "lasers.worst_pct"

struct adaptive_hooks {
    /* A round was chosen and stored; 0: everything is known, and the rest has been left out.
     * message: what was found, for the session's events. error: nothing was chosen; a file cannot
     * be read, or the session not be written. */
    void (*chosen)(int n, const char *message, const GError *error, gpointer data);
    gpointer data;
};

/* shots: all of the session's, as long as it lives; their states are read in the main loop. nominal
 * is the rig's as the plan had it, calibrated the session's; both are copied. Sweeps that are done
 * are examined from their files. NULL: the session cannot be read or written, or its values are not
 * as described above. */
Adaptive *adaptive_new(Session *session, const struct session_conf *conf, const GPtrArray *shots,
                       const struct rig *nominal, const struct rig *calibrated, Clock *clock,
                       const struct adaptive_hooks *hooks, GError **error);
void adaptive_free(Adaptive *adaptive); /* NULL is ignored; no hook is called after it */

/* Whether a shot is in a round; those that are no sweeps always are. */
gboolean adaptive_is_chosen(const Adaptive *adaptive, const struct session_shot *shot);

/* A sweep was committed. */
void adaptive_take(Adaptive *adaptive, const struct session_shot *shot,
                   const struct session_frame *frames, int n);

/* Call it when all chosen shots are done. Answers by the hook, later. */
void adaptive_choose(Adaptive *adaptive);
/* A round without a shot was stored: all there is to choose is chosen. */
gboolean adaptive_is_over(const Adaptive *adaptive);
