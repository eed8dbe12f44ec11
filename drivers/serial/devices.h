/* The driver of axes on boards that speak G-code. It works in real time only. */
#pragma once

#include "drivers/axis.h"

extern const struct axis_driver gcode_axis_driver;
