/* Totals of a session that its report shows: frames, retakes and real time, over all of its runs.
 * They are stored as values of the session together with its clock. Owned by the Capture. Main
 * loop's thread. */
#pragma once

#include "capture_session.h"
#include "exposure_advice.h"

struct run_totals {
    /* Numbers of frames of this run: accepted frames, and frames that were refused and taken
     * again. */
    gint64 frames, retakes;
    /* repetitions of saturated pictures in all runs */
    struct exposure_retakes exposures;
    /* Totals of earlier runs: real time in seconds, accepted frames, and retakes. */
    double real_base_s, frames_base, retakes_base;
    gint64 begun_us; /* monotonic time when this run began */
    /* value of the session's clock when the totals were last saved */
    double saved_s;
};

/* Begins a run with the totals of earlier runs. */
gboolean run_totals_load(struct run_totals *totals, const struct capture_session *session,
                         GError **error);
void run_totals_save(struct run_totals *totals, const struct capture_session *session);
/* Saves the totals if they were last saved at least 10 s ago on the session's clock. */
void run_totals_save_if_due(struct run_totals *totals, const struct capture_session *session);
