/* Photon transfer (radiometry/photon_transfer.h) from the raw exposures that a session has kept. */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

/* For each camera with kept dark frames and pairs of exposures under a lamp (the brightest shot):
 * sets calibration's noise. ret_n: number of such cameras. Unusable pairs are an error, missing
 * ones are not. */
gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error);
