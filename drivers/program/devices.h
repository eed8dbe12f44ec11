/* The drivers of devices that are programs. docs/build-a-rig/programs.md says how to write one. */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/lamps.h"

extern const struct axis_driver program_axis_driver;
extern const struct camera_driver program_camera_driver;
extern const struct lamps_driver program_lamps_driver;
