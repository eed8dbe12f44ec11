/*
 * From a session of a white tile to the radiometry of its rig (radiometry/radiometry.h): every lamp
 * frame shows the tile, whose face is the session's reference plane. Marks beside it are calibrated
 * along with it. Where single exposures were kept, as pairs, they tell each camera's noise and
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
    double residual, quality; /* relative, RMS; chi-square a degree of freedom */
    double drift;             /* largest less least output of a lamp, of its mean */
    int marks;                /* that were calibrated */
    int transfers;            /* cameras whose noise is known */
};

/* Improves what calibration knows and says so in its part CALIBRATION_RADIOMETRY. Geometry is taken
 * as it is there. Errors of single pictures are kept with the part as rejected ones. */
gboolean tile_session(Session *session, struct calibration *calibration,
                      const struct tile_options *options, struct tile_result *ret, GError **error);
