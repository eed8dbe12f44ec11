/* Test shots before a long capture, which show mistakes that would spoil all of it. */
#pragma once

#include "calibration/calibration.h"
#include "common/link.h"
#include "plan/plan.h"

/* Whether the BTF of a session has so many pictures, views × lights, that a few test shots hardly
 * prolong it. Exposures of a bracket, dark frames and laser sweeps do not count. */
gboolean guard_is_worth_it(const struct session_conf *conf, const struct rig *rig);

/* Homes turntable and arc, turns the arc to a planned light away from the cameras, and takes test
 * shots, each with every camera that the session plans with: one in the dark, and one under each
 * planned lamp, at the session's shortest and longest exposures. If the first five shots show that
 * something is wrong, no others are taken. Otherwise one shot of each lamp beyond the fourth
 * follows: a shot of several lamps together would not show that one of them is dead.
 *
 * Returns sentences (char *), each with what was measured and which key or device to change: a rig
 * that is not calibrated (calibration says which parts are); a camera that saturates or stays dark,
 * or sees no lamp; a lamp that no camera sees; fiducials that are not where the calibration has
 * them. ret_shots: how many test shots were taken. NULL: a device failed. */
GPtrArray *guard_try(Link *link, const struct session_conf *conf, const struct rig *rig,
                     const struct calibration *calibration, int *ret_shots, GError **error);
