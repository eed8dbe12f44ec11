/* The pairs of view and light in a session's plan: their directions, the positions of camera and
 * lamp, and the shot that takes each pair. Constant after session_pairs_new(): any thread. */
#pragma once

#include "geometry/rig.h"
#include "prediction.h"
#include "session/session.h"

struct session_pairs {
    /* All pairs, as prediction_new() needs them. Positions are in the sample frame. The group of a
     * pair is the id of the shot that takes the pair. If no shot takes it, the group is −1 − p,
     * where p is the index of the pair. */
    struct prediction_pairs all;
    int n_cameras;
    int *pair_of; /* for each shot and camera: the pair that it shows, or −1 */
};

/* Lists the pairs. rig is calibrated, with the turntable at 0. views and lights contain struct
 * session_direction, shots struct session_shot. Skipped shots take no pair. The plan may shift the
 * arc from shot to shot; the position of a lamp is that in the first shot of its light. */
struct session_pairs *session_pairs_new(const struct rig *rig, const GPtrArray *views,
                                        const GPtrArray *lights, const GPtrArray *shots);
void session_pairs_free(struct session_pairs *pairs); /* NULL is ignored */

static inline int session_pairs_n(const struct session_pairs *pairs) {
    return pairs->all.n_views * pairs->all.n_lights;
}

/* Returns the pair that a camera shows in a shot, or −1 if it shows none. */
int session_pairs_of(const struct session_pairs *pairs, const struct session_shot *shot,
                     int camera);
