/* Photon transfer (radiometry/photon_transfer.h) from the raw exposures that a session has kept. */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

/* Sets the noise in the calibration for each camera of which the session has kept pairs of
 * exposures both in the dark and under a lamp. Other cameras are left out. *ret_n receives the
 * number of cameras whose noise was set. If several shots have kept pairs, those of the brightest
 * shot are used. Fails if pairs cannot be used. */
gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error);
