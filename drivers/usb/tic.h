/* Pololu Tic stepper controllers, connected by USB. */
#pragma once

#include "drivers/axis.h"

extern const struct axis_driver tic_axis_driver;
