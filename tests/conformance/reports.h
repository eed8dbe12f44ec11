/*
 * Checks that a driver reports as the header of its class demands: once for each command that it
 * accepted, and never from within the call. The classes ignore most surplus reports, so listeners
 * do not see surplus reports. The linker therefore sends the drivers' calls of lamps_report() and
 * the like through this module (--wrap, in tests/CMakeLists.txt). A report that no command waits
 * for ends the test program.
 *
 * Each function returns a driver that passes all calls on to the driver that was given. The
 * returned driver is valid until the next call of the same function. Only one device at a time may
 * be open with the returned driver.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

const struct axis_driver *reports_of_axis(const struct axis_driver *driver);
const struct lamps_driver *reports_of_lamps(const struct lamps_driver *driver);
const struct camera_driver *reports_of_camera(const struct camera_driver *driver);
const struct laser_driver *reports_of_laser(const struct laser_driver *driver);

/* An interlock has no commands. *ret_n is the number of its reports since it was opened. */
const struct interlock_driver *reports_of_interlock(const struct interlock_driver *driver,
                                                    const int **ret_n);
