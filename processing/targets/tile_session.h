/*
 * Radiometric calibration from a session of a white tile (radiometry/radiometry.h). Every lamp
 * frame shows the tile, whose face is the session's reference plane. Fiducials next to the tile are
 * calibrated with it. If raw exposures were kept in pairs, they give each camera's noise and
 * linearity.
 */
#pragma once

#include "base/work.h"
#include "calibration/calibration.h"
#include "session/session.h"

struct tile_options {
    double reflectance[3];      /* reflectance of the tile for red, green and blue of the cameras */
    double width_mm, height_mm; /* size of the tile; 0 means the size of the session's sample */
    const struct work *work;    /* threads, progress and cancelling; may be NULL */
};

struct tile_result {
    int pictures, cells; /* numbers of pictures and of cells in the fit */
    /* residual: RMS of the fit, relative to the signal
     * quality: χ² per degree of freedom */
    double residual, quality;
    double expected; /* residual that noise and a model error of 0.05 % explain, relative to the
                        signal */
    double exponent_off, aim_off_rad; /* RMS of the lamps' deviations, as in struct tile_fit */
    /* range of the outputs (maximum minus minimum) over all shots, relative to the mean of each
     * lamp */
    double drift;
    int marks;     /* number of calibrated fiducials */
    int transfers; /* number of cameras with known noise */
};

/* Updates the calibration and its part CALIBRATION_RADIOMETRY. Of the geometry, only the aims of
 * lamps and the positions of fiducials are changed. The output of each shot's lamp is stored in the
 * section [lamp drift] of calibration->extra. Errors of single pictures are recorded in the part as
 * rejected pictures. The progress stages are "tile", "glare" and "marks".
 *
 * Fails if
 * - no picture can be used,
 * - the pictures do not fit a tile; if they would fit with two lamps exchanged or with other
 *   angles, the error says so,
 * - a fiducial would reflect more than 1.1 times the light that falls on it, or
 * - cancelled.
 * After an error, the rig is as before, but other parts of the calibration may have changed. */
gboolean tile_session(Session *session, struct calibration *calibration,
                      const struct tile_options *options, struct tile_result *ret, GError **error);
