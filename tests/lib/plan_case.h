/* Rigs and sessions for the tests of daemon/plan. */
#pragma once

#include "plan/plan.h"

/* Returns a session of 50 × 50 mm and 64 texels. directions has the sections [views], [lights] and
 * [lasers]. */
struct session_conf plan_case_conf(const char *directions);

/* Returns a rig with cameras, lamps and lasers at the same n elevations, as in
 * etc/demo/rig.conf. */
struct rig plan_case_rig(const double *theta_deg, int n);
struct rig_timing plan_case_timing(double warm_up_s);

struct plan *plan_case_build(const struct session_conf *conf, const struct rig *rig,
                             const struct rig_timing *timing);

/* Checks that planning fails with this code and with a message that contains these words. */
void plan_case_refused(const struct session_conf *conf, const struct rig *rig,
                       const struct rig_timing *timing, int code, const char *says);
