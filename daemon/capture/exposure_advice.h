/* Whether the exposures of a session were so long that most pictures were saturated and had to be
 * taken again. Main loop's thread. */
#pragma once

#include "session/session.h"

struct exposure_retakes {
    int n;              /* pictures taken again since they were saturated */
    gint64 shortest_us; /* the shortest exposure that one of them was taken again with; 0: none */
};

/* shortened_us: as the sequencer's hook “retake” has it. */
void exposure_advice_count(struct exposure_retakes *retakes, gint64 shortened_us);

/* Reads and writes the session's value "saturated_retakes", the sum over all runs. FALSE: it cannot
 * be read, and *ret is 0. */
gboolean exposure_advice_load(struct exposure_retakes *ret, Session *session, GError **error);
void exposure_advice_save(const struct exposure_retakes *retakes, Session *session);

/* A sentence with what to change, if there were at least half as many such retakes as pictures
 * under lamps, or if more than half of the values lack the longest exposure, which saturates.
 * lacking: the share of those, 0 if it is not known. Else NULL. g_free(). */
char *exposure_advice(Session *session, double lacking);
