/* Advice for sessions whose exposures were so long that most pictures were saturated and had to be
 * repeated. All functions belong to the main loop's thread. */
#pragma once

#include "session/session.h"

struct exposure_retakes {
    int n;              /* number of pictures that were repeated because they were saturated */
    gint64 shortest_us; /* the shortest exposure of these repetitions in µs; 0 if there were none */
};

/* Counts a picture that is taken again, if it was saturated. shortened_us is the argument of the
 * hook “retake” (sequencer.h): the shorter exposure after saturation, otherwise 0. */
void exposure_advice_count(struct exposure_retakes *retakes, gint64 shortened_us);

/* Read and write the session's value "saturated_retakes", the sum over all runs.
 * exposure_advice_load() returns FALSE with an error if the value cannot be read; *ret is then
 * 0. */
gboolean exposure_advice_load(struct exposure_retakes *ret, Session *session, GError **error);
void exposure_advice_save(const struct exposure_retakes *retakes, Session *session);

/* Returns a sentence that says which exposures to change, or NULL if there is no advice. Free it
 * with g_free(). There is advice in two cases:
 * - Saturated pictures were repeated at least half as many times as there are pictures under lamps.
 * - `lacking` is above one half. `lacking` is the share of the values of the BTF whose longest
 *   exposure is saturated, or 0 if this is not known. */
char *exposure_advice(Session *session, double lacking);
