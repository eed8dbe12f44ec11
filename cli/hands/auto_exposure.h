/*
 * Chooses the exposures that are "auto" in a session file, from trial pictures before the capture.
 *
 * exposures_us: up to four lamps (trial.h) are lit one after the other. Each camera takes pictures
 * until one is neither saturated nor dark, and each picture corrects the exposure of the next. At
 * the shortest exposure, saturated_pct % of the pixels of the brightest of these pictures are above
 * 0.7 of the range. The longest exposure brings the 99th percentile of the dimmest picture to 0.2
 * of the range, and is at least four times the shortest. There are two exposures, or three if the
 * longest is more than four times the shortest.
 *
 * laser_exposure_us, laser_short_us: up to two lasers are switched on, without a lamp, and stand
 * still at three places of the sample. The line is assumed to cover as many pixels as half the
 * picture's longer side. The exposure is chosen so that the line reaches a twentieth of the range,
 * or twice laser_threshold_dn if that is more, in the dimmest picture. If as many pixels as a
 * hundredth of the longer side then saturate in the brightest picture, a shorter exposure is chosen
 * as well. If laser_short_us = 0 forbids this, the exposure is reduced until nothing saturates.
 *
 * The same pictures give the same exposures. A laser that is mounted by hand is not tried.
 */
#pragma once

#include "common/link.h"
#include "plan/plan.h"

/* Chooses the exposures. Returns lines for session_conf_choose(), which are empty if nothing is
 * auto; g_free(). rig_path is the path of the rig file. Returns NULL with an error if a device has
 * failed or if no exposure is suitable. If no exposure is suitable, the error names the camera and
 * the light, the necessary exposure, and the key to change. */
char *auto_exposure_choose(Link *link, const struct session_conf *conf, const char *rig_path,
                           GError **error);
