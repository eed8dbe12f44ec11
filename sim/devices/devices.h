/*
 * The simulated devices: drivers of every class that act on a World or look at it. They work in
 * real time and in virtual time, have the delays that their options give, and can fail on request.
 * `mesorig drivers` describes every option.
 *
 * Before you write another driver, read the axis, which is the simplest one.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

/* Returns the true position of the load when the drive is at deg, without backlash.
 * position_error_deg is the largest position error of the drive. If wraps is TRUE, deg and deg +
 * 360 are the same position. */
double sim_axis_true_deg(double deg, gboolean wraps, double position_error_deg, int error_seed);

/* Return the time on the rig's clock until which a device neither obeys nor answers (fault_dead_s).
 * If this time has passed, the device works. */
gint64 sim_laser_dead_until_us(const Laser *laser);
gint64 sim_lamps_dead_until_us(const LampBank *bank);

extern const struct axis_driver sim_axis_driver;
extern const struct lamps_driver sim_lamps_driver;
extern const struct camera_driver sim_camera_driver;
extern const struct laser_driver sim_laser_driver;
extern const struct interlock_driver sim_interlock_driver;
