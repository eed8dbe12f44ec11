/* The drivers of devices on serial ports: axes on boards that speak G-code, and lamps on an LED
 * controller. They work in real time only. */
#pragma once

#include "drivers/axis.h"
#include "drivers/lamps.h"

extern const struct axis_driver gcode_axis_driver;
extern const struct lamps_driver serial_lamps_driver;
