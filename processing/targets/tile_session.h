/*
 * Radiometric calibration from a session of a white tile (radiometry/radiometry.h): every lamp
 * frame shows the tile, whose face is the session's reference plane. Fiducials next to it are
 * calibrated along with it. Raw exposures that were kept in pairs give each camera's noise and
 * linearity.
 */
#pragma once

#include "base/work.h"
#include "calibration/calibration.h"
#include "session/session.h"

struct tile_options {
    double reflectance[3];      /* of the tile, at the cameras' red, green, blue */
    double width_mm, height_mm; /* of the tile; 0: the session's sample */
    const struct work *work;    /* may be NULL */
};

struct tile_result {
    int pictures, cells;
    double residual, quality;         /* relative RMS; χ² per degree of freedom */
    double expected;                  /* residual that noise explains, relative */
    double exponent_off, aim_off_rad; /* of the lamps, RMS, as in struct tile_fit */
    double drift;  /* largest minus least output of a lamp, relative to its mean */
    int marks;     /* number of calibrated fiducials */
    int transfers; /* number of cameras with known noise */
};

/* Updates the calibration and its part CALIBRATION_RADIOMETRY. The geometry is taken as it is.
 * Errors of single pictures are recorded with the part as rejected ones. */
gboolean tile_session(Session *session, struct calibration *calibration,
                      const struct tile_options *options, struct tile_result *ret, GError **error);
