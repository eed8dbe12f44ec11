/* Photon transfer (radiometry/photon_transfer.h) from the raw exposures that a session has kept. */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

/* Sets the noise in the calibration for each camera with kept dark frames and pairs of exposures
 * under a lamp (of the brightest shot). ret_n is the number of such cameras. Pairs that cannot be
 * used are an error; missing pairs are not. */
gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error);
