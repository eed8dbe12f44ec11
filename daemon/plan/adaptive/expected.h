/*
 * What a session is expected to bring before it is begun: the error of its BTF against the time
 * that its lamps take, if they are taken in rounds ([lights] sampling = adaptive), whether the
 * session says so or not. Any thread; it may take minutes.
 */
#pragma once

#include "base/work.h"
#include "plan/plan.h"

struct expected_point {
    int shots;        /* of lamps */
    double time_s;    /* of these shots, by the plan's times; sweeps are not counted */
    double error_pct; /* as ADAPTIVE_ERROR_PCT */
};

/* like: directory of an earlier session of the same or such a material. What it measured, and what
 * is predicted of it where the directions are others, stands for what the session will measure: the
 * choice is made as it would be (lamps.h), in rounds half as large. NULL: of no particular
 * material. At most half of the shots are looked at; without like an eighth if there are many. An
 * array of struct expected_point, in order of time; g_array_unref(). DATA_ERROR_INCOMPLETE: the
 * earlier session has no pictures, or the plan no lamps. */
GArray *expected_curve(const struct session_conf *conf, const struct rig *rig,
                       const struct rig_timing *timing, const struct plan *plan, const char *like,
                       const struct work *work, GError **error);
