/*
 * Predicts the result of a session before it begins: the error of its BTF as a function of the time
 * of its lamps. The shots are assumed to be taken in rounds ([lights] sampling = adaptive), even if
 * the session does not say so. Any thread may call the function. It may take minutes.
 */
#pragma once

#include "base/work.h"
#include "plan/plan.h"

struct expected_point {
    int shots;     /* number of shots of lamps */
    double time_s; /* predicted time of these shots, without sweeps */
    /* expected error after these shots, defined as ADAPTIVE_ERROR_PCT (adaptive.h) */
    double error_pct;
};

/* Computes the expected error after increasing numbers of shots. Returns an array of struct
 * expected_point, in order of time; g_array_unref().
 *
 * `like` is the directory of an earlier session of the same or a similar material, or NULL. The
 * measured values of the earlier session are used for the new session. For directions that the
 * earlier session does not have, values are predicted. The shots are then chosen as during a
 * capture (lamps.h), but a round has at most half as many shots as all earlier rounds together. If
 * `like` is NULL, the prediction is for no particular material.
 *
 * At most half of the shots are considered. If `like` is NULL and there are more than
 * PREDICTION_TARGETS pairs of a view and a light, at most an eighth of the shots is considered.
 *
 * On failure, returns NULL with one of these errors:
 * - DATA_ERROR_INVALID: the earlier session has no picture under a lamp.
 * - DATA_ERROR_INCOMPLETE: the plan has fewer than two views, or fewer than two shots of lamps.
 * - An error of reading the earlier session. */
GArray *expected_curve(const struct session_conf *conf, const struct rig *rig,
                       const struct rig_timing *timing, const struct plan *plan, const char *like,
                       const struct work *work, GError **error);
