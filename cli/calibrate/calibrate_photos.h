/* calibrate lights --images: no rig, photographs with balls in them. */
#pragma once

#include "common/cli.h"

extern char *photos_folder, **photos_balls;
extern double photos_radius_mm, photos_focal_px; /* 0: not given */
extern double photos_within_deg; /* standard error of a direction, from which it is refused */

/* Writes an .lp file to -o as RTI programs read it: a line with the number of photographs, then one
 * a photograph: its name and the direction of its light, x to the right, y up, z to the camera.
 * With several balls also the lamp's place. Returns an exit code. */
int photos_calibrate(const struct call *call, GError **error);
