/* Advice for sessions whose exposures were so long that most pictures were saturated and had to be
 * repeated. Main loop's thread. */
#pragma once

#include "session/session.h"

struct exposure_retakes {
    int n;              /* number of repetitions of pictures because they were saturated */
    gint64 shortest_us; /* the shortest exposure of such a repetition; 0 if there was none */
};

/* Counts a retake if a saturated picture was repeated (shortened_us is above 0). shortened_us is an
 * argument of the hook “retake” (sequencer.h). */
void exposure_advice_count(struct exposure_retakes *retakes, gint64 shortened_us);

/* Read and write the session's value "saturated_retakes", the sum over all runs.
 * exposure_advice_load() returns FALSE if the value cannot be read; *ret is then 0. */
gboolean exposure_advice_load(struct exposure_retakes *ret, Session *session, GError **error);
void exposure_advice_save(const struct exposure_retakes *retakes, Session *session);

/* Returns a sentence that says which exposures to change, or NULL; g_free(). There is advice if
 * saturated pictures were repeated at least half as many times as there are pictures under lamps.
 * There is also advice if `lacking` is above one half. `lacking` is the share of the values of the
 * BTF whose longest exposure is saturated; it is 0 if the share is not known. */
char *exposure_advice(Session *session, double lacking);
