/* calibrate laser --images: calibrates a laser that stands still from photographs of a board with
 * the laser's line. */
#pragma once

#include "common/cli.h"

extern char *laser_images_folder, *laser_images_dark, *laser_images_board, *laser_images_name,
    *laser_images_plane;

int laser_images_calibrate(const struct call *call, GError **error);
