/* Totals of a session for its report: frames, retakes and real time, over all runs. They are stored
 * as values of the session, together with the session's clock. The struct is owned by the Capture.
 * All functions belong to the main loop's thread. */
#pragma once

#include "capture_session.h"
#include "exposure_advice.h"

struct run_totals {
    /* Numbers of frames in this run: frames that were accepted, and frames that were refused and
     * taken again. */
    gint64 frames, retakes;
    /* pictures of all runs that were repeated because they were saturated */
    struct exposure_retakes exposures;
    /* Totals of earlier runs: real time in seconds, number of accepted frames, and number of
     * retakes. */
    double real_base_s, frames_base, retakes_base;
    gint64 begun_us; /* monotonic time when this run began */
    /* value of the session's clock when the totals were last saved */
    double saved_s;
};

/* Begins a run, and loads the totals of earlier runs. Returns FALSE with an error if they cannot be
 * read. */
gboolean run_totals_load(struct run_totals *totals, const struct capture_session *session,
                         GError **error);
void run_totals_save(struct run_totals *totals, const struct capture_session *session);
/* Saves the totals if they were last saved at least 10 s ago on the session's clock. */
void run_totals_save_if_due(struct run_totals *totals, const struct capture_session *session);
