/* Estimates the disk space of a session that is being captured. The estimate begins with that of
 * the plan and is corrected by the frames stored so far. The struct belongs to the Capture. All
 * functions belong to the main loop's thread. */
#pragma once

#include "capture_session.h"

struct capture_bytes {
    /* Sums over the stored frames of each kind (enum session_shot_kind) and camera. `sum` is their
     * size on disk in bytes, and `planned` is the size in bytes that the plan expected. */
    struct {
        double sum, planned;
    } of[SHOT_SWEEP + 1][RIG_MAX_CAMERAS];
    /* array with one footprint for each camera; NULL until it is needed */
    struct plan_footprint *footprints;
    /* Planned bytes of each shot (row) and camera (column), or NULL until they are needed. A value
     * is 0 if the camera takes no frame in the shot, or if the shot was not to be taken any more
     * when the array was made. */
    float *planned;
    double stored; /* bytes of the stored frames on disk, including their rows in the database */
    /* Expected bytes of the whole session. `expected` is the present value, and `said` is the value
     * in the last event. */
    double expected, said;
};

/* Loads the estimate of the plan or of an earlier run. */
gboolean capture_bytes_load(struct capture_bytes *bytes, const struct capture_session *session,
                            GError **error);
void capture_bytes_clear(struct capture_bytes *bytes);

/* Counts the frames of earlier runs of the session, because the estimate uses them too. frames has
 * struct session_frame. Call it once for a resumed session, before anything is captured. */
void capture_bytes_begin(struct capture_bytes *bytes, const struct capture_session *session,
                         const GPtrArray *frames);

/* Counts the n frames of a shot that was just stored. n_committed is the number of shots that this
 * run has stored, including this one. is_last is TRUE for the last shot of the run.
 *
 * The estimate is updated only after some of the shots, because an update takes long. An event is
 * added when the expected size of the whole session differs by more than a twentieth from the size
 * in the last event. */
void capture_bytes_add(struct capture_bytes *bytes, const struct capture_session *session,
                       const struct session_shot *shot, const struct session_frame *frames, int n,
                       guint n_committed, gboolean is_last);
