/* calibrate lights --images: works without a rig, on photographs with balls in them. */
#pragma once

#include "common/cli.h"

/* photos_folder is the folder of photographs. photos_balls has the position and the radius of each
 * ball in pixels, as texts "X,Y,R", with NULL after the last. Each variable is NULL if its option
 * is not given. */
extern char *photos_folder, **photos_balls;
extern double photos_radius_mm, photos_focal_px; /* 0 if not given */
/* photos_dome_mm is the distance of the lamps from the middle of the dome, or 0. photos_middle says
 * where the middle of the dome is in the photographs, as the text "X,Y" in pixels. NULL means the
 * middle of the picture. The middle of the dome must be on the plate on which the balls lie. */
extern double photos_dome_mm;
extern char *photos_middle;
/* A photograph is left out if the standard error of its direction is larger than this. */
extern double photos_within_deg;

/* Writes an .lp file to -o, as RTI programs read it. The first line of the file is the number of
 * photographs. Each further line has the name of a photograph and the direction of its light: x to
 * the right, y up, z to the camera. With photos_dome_mm, a line has the position of the lamp in mm,
 * relative to the middle of the dome, instead of the direction.
 *
 * If there are several balls, the record also contains the lamp's place. Returns an exit code. */
int photos_calibrate(const struct call *call, GError **error);
