/* Totals of a session that its report shows: frames, retakes and real time, over all of its runs.
 * They are stored as values of the session together with its clock. Owned by the Capture. Main
 * loop's thread. */
#pragma once

#include "capture_session.h"
#include "exposure_advice.h"

struct run_totals {
    gint64 frames, retakes; /* accepted frames of this run; frames refused and repeated */
    struct exposure_retakes exposures;             /* of all runs */
    double real_base_s, frames_base, retakes_base; /* of earlier runs */
    gint64 begun_us;                               /* real time, monotonic */
    double saved_s;                                /* value of the session's clock at that time */
};

/* Begins a run with the totals of the earlier ones. */
gboolean run_totals_load(struct run_totals *totals, const struct capture_session *session,
                         GError **error);
void run_totals_save(struct run_totals *totals, const struct capture_session *session);
/* Saves the totals if they were last saved at least 10 s ago on the session's clock. */
void run_totals_save_if_due(struct run_totals *totals, const struct capture_session *session);
