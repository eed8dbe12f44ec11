/*
 * Chooses the exposures that are "auto" in a session file, from trial pictures before the capture.
 *
 * exposures_us: up to four lamps (trial.h) are lit one after the other. Each camera takes pictures
 * until one is neither saturated nor dark; each picture corrects the exposure of the next. The
 * session gets two exposures, or three if the longest is more than four times the shortest:
 * - At the shortest exposure, saturated_pct % of the pixels of the brightest of these pictures are
 *   above 0.7 of the range.
 * - At the longest exposure, the 99th percentile of the dimmest picture reaches 0.2 of the range.
 *   The longest exposure is at least four times the shortest.
 *
 * laser_exposure_us, laser_short_us: up to two lasers are switched on, without a lamp, and stand
 * still at three places of the sample. The line is assumed to cover as many pixels as half the
 * picture's longer side. laser_exposure_us is chosen so that the line in the dimmest picture
 * reaches a twentieth of the range, or twice laser_threshold_dn if that is more.
 *
 * At this exposure, as many pixels as a hundredth of the longer side may saturate in the brightest
 * picture. A shorter exposure is then chosen for laser_short_us. If laser_short_us = 0 forbids
 * this, laser_exposure_us is reduced until these pixels do not saturate.
 *
 * The same pictures give the same exposures. A laser that is mounted by hand is not tried.
 */
#pragma once

#include "common/link.h"
#include "plan/plan.h"

/* Chooses the exposures. rig_path is the path of the rig file. Returns lines for
 * session_conf_choose(), to be freed with g_free(); the text is empty if no exposure is "auto".
 *
 * Returns NULL with an error if a device has failed or if no exposure is suitable. In the second
 * case, the error names the camera and the light, the necessary exposure, and the key to change. */
char *auto_exposure_choose(Link *link, const struct session_conf *conf, const char *rig_path,
                           GError **error);
