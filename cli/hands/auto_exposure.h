/*
 * Exposures that are "auto" in a session file, chosen by pictures on trial before the capture.
 *
 * exposures_us: up to four lamps (trial.h) are lit one after the other, and each camera takes
 * pictures, each shorter or longer by what the one before showed, until one is neither saturated
 * nor dark. The shortest exposure brings the brightest of these pictures to 0.7 of the range, at
 * the quantile that saturated_pct leaves; the longest one brings the 99th percentile of the dimmest
 * to 0.2, and is at least four times the shortest. There are two, or three if they are more than
 * four times apart.
 *
 * laser_exposure_us, laser_short_us: up to two lasers stand still at three places of the sample,
 * without a lamp. The line is taken to cover as many pixels as half the picture's longer side. The
 * exposure is such that the line reaches a twentieth of the range in the dimmest picture. If a
 * hundredth of the line then saturates in the brightest picture, a shorter exposure is chosen as
 * well; if laser_short_us = 0 forbids that, the exposure is reduced until nothing saturates.
 *
 * The same pictures give the same exposures. A laser that is mounted by hand is not tried.
 */
#pragma once

#include "common/link.h"
#include "plan/plan.h"

/* Lines for session_conf_choose(), empty if nothing is auto; g_free(). rig_path: of the rig file.
 * NULL: a device failed, or no exposure serves: the error says which camera and light, the exposure
 * that it would take, and the key to change. */
char *auto_exposure_choose(Link *link, const struct session_conf *conf, const char *rig_path,
                           GError **error);
