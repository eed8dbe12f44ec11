/* Photon transfer (radiometry/photon_transfer.h) from the single exposures that a session has kept.
 */
#pragma once

#include "calibration/calibration.h"
#include "session/session.h"

/* For each camera of which the session has kept dark frames, and pairs of exposures under a lamp:
 * of the shot that is lit best. Sets calibration's noise. ret_n: for how many cameras. Pairs that
 * are of no use are an error, missing ones are none. */
gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error);
