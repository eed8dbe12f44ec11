/* Estimate of the disk space of a session that is being captured. It begins with the plan's
 * estimate and is corrected by the frames stored so far. The struct belongs to the Capture. Main
 * loop's thread. */
#pragma once

#include "capture_session.h"

struct capture_bytes {
    /* Of the stored frames by kind (enum session_shot_kind) and camera: as they are on disk (sum),
     * and as the plan expected them (planned). */
    struct {
        double sum, planned;
    } of[SHOT_SWEEP + 1][RIG_MAX_CAMERAS];
    struct plan_footprint *footprints; /* of each camera; NULL until they are needed */
    /* shots × cameras, as planned; 0 if a shot is not to be taken; NULL until they are needed */
    float *planned;
    double stored; /* on disk, including the rows of the frames */
    /* of the whole session: the present value, and the value in the last event */
    double expected, said;
};

/* Loads the estimate of the plan or of an earlier run. */
gboolean capture_bytes_load(struct capture_bytes *bytes, const struct capture_session *session,
                            GError **error);
void capture_bytes_clear(struct capture_bytes *bytes);

/* Counts the frames of earlier runs of the session, which the estimate uses as well. frames
 * contains struct session_frame. To be called once, before anything is captured. */
void capture_bytes_begin(struct capture_bytes *bytes, const struct capture_session *session,
                         const GPtrArray *frames);

/* Counts the frames of a shot that was committed. n_committed is the number of shots that this run
 * has committed, including this one. is_last says that the shot is the last one of the run. Adds an
 * event when the expected size of the whole session differs by more than a twentieth from the size
 * in the last event. */
void capture_bytes_add(struct capture_bytes *bytes, const struct capture_session *session,
                       const struct session_shot *shot, const struct session_frame *frames, int n,
                       guint n_committed, gboolean is_last);
