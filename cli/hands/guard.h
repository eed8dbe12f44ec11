/* Test shots before a long capture. They show mistakes that would spoil the whole capture. */
#pragma once

#include "calibration/calibration.h"
#include "common/link.h"
#include "plan/plan.h"

/* Returns whether a few test shots hardly lengthen the capture, because the BTF of the session has
 * many pictures (views × lights). Exposures of a bracket, dark frames and laser sweeps do not count
 * as pictures. */
gboolean guard_is_worth_it(const struct session_conf *conf, const struct rig *rig);

/* Homes turntable, arc, arm and probe, turns the arc to a planned light that is far from the
 * cameras, and takes test shots with all cameras in the session's plan. The first test shot is
 * dark. Then there is one shot under each planned lamp, with the session's shortest and longest
 * exposures.
 *
 * If the first five shots show a mistake, no others are taken. In the further shots, the cameras
 * take pictures only until one of them sees the lamp. Each shot has only one lamp, because a shot
 * with several lamps would not show that one of them is dead.
 *
 * Returns warnings as sentences (char *). Each says what was measured, and which key or device to
 * change. The warnings are about:
 * - parts of the rig that are not calibrated according to calibration,
 * - a camera that saturates, stays dark, or sees no lamp,
 * - a lamp that no camera sees,
 * - fiducials that are not where the calibration has them.
 *
 * *ret_shots is the number of test shots. Returns NULL with an error if a device has failed. */
GPtrArray *guard_try(Link *link, const struct session_conf *conf, const struct rig *rig,
                     const struct calibration *calibration, int *ret_shots, GError **error);
