/* Advice for sessions whose exposures were so long that most pictures were saturated and had to be
 * repeated. Main loop's thread. */
#pragma once

#include "session/session.h"

struct exposure_retakes {
    int n;              /* number of pictures that were repeated because they were saturated */
    gint64 shortest_us; /* the shortest exposure of such a repetition; 0 if there was none */
};

/* Counts a retake. The hook “retake” of the sequencer gives shortened_us. */
void exposure_advice_count(struct exposure_retakes *retakes, gint64 shortened_us);

/* Read and write the session's value "saturated_retakes", the sum over all runs.
 * exposure_advice_load() returns FALSE if the value cannot be read; *ret is then 0. */
gboolean exposure_advice_load(struct exposure_retakes *ret, Session *session, GError **error);
void exposure_advice_save(const struct exposure_retakes *retakes, Session *session);

/* Returns a sentence that says which exposures to change, or NULL. There is advice if such
 * repetitions were at least half as many as the pictures under lamps, or if more than half of the
 * values lack the longest exposure because it is saturated. lacking is the share of these values, 0
 * if it is not known. g_free() */
char *exposure_advice(Session *session, double lacking);
