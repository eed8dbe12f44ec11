/* calibrate lights --images: works without a rig, on photographs with balls in them. */
#pragma once

#include "common/cli.h"

/* The folder of photographs, and the position and radius of each ball in pixels, as texts "X,Y,R".
 * photos_balls ends with NULL. Each is NULL if not given. */
extern char *photos_folder, **photos_balls;
extern double photos_radius_mm, photos_focal_px; /* 0 if not given */
/* photos_dome_mm is the distance of the lamps from the middle of the dome, or 0. photos_middle is
 * the text "X,Y" of the place in pixels at which the middle of the dome is in the photographs. The
 * middle of the dome is on the plate on which the balls lie. NULL means the middle of the picture.
 */
extern double photos_dome_mm;
extern char *photos_middle;
/* If the standard error of a direction is larger than this, its photograph is left out. */
extern double photos_within_deg;

/* Writes an .lp file to -o, as RTI programs read it. Its first line is the number of photographs.
 * Each further line has the name of a photograph and the direction of its light: x to the right, y
 * up, z to the camera. With several balls, the record also contains the lamp's place. With
 * photos_dome_mm, the lines have the position of the lamp in mm, relative to the middle of the
 * dome, instead of the direction. Returns an exit code. */
int photos_calibrate(const struct call *call, GError **error);
