/* calibrate laser --images: calibrates a laser that does not move, from photographs of a board on
 * which the laser's line falls. */
#pragma once

#include "common/cli.h"

/* The values of --images, --dark-images, --board, --name and --plane. Each is NULL if the option is
 * not given. */
extern char *laser_images_folder, *laser_images_dark, *laser_images_board, *laser_images_name,
    *laser_images_plane;

/* Runs the command with the option values above. Writes the calibration to -o. Returns an exit
 * code. */
int laser_images_calibrate(const struct call *call, GError **error);
