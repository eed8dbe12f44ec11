/*
 * The simulated devices are drivers of every class. They act on a World or look at it. They work in
 * real time and in virtual time, have the delays that their options give, and can fail on request.
 * `mesorig drivers` describes every option. The axis is the simplest driver to read before you
 * write another.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

/* Returns the position of the load when the drive stands at deg, without backlash.
 * position_error_deg is the largest position error of the drive. wraps says that deg and deg + 360
 * are the same position. */
double sim_axis_true_deg(double deg, gboolean wraps, double position_error_deg, int error_seed);

/* Return the time until which a device neither obeys nor answers (fault_dead_s). The time is on the
 * rig's clock. If it has passed, the device works. */
gint64 sim_laser_dead_until_us(const Laser *laser);
gint64 sim_lamps_dead_until_us(const LampBank *bank);

extern const struct axis_driver sim_axis_driver;
extern const struct lamps_driver sim_lamps_driver;
extern const struct camera_driver sim_camera_driver;
extern const struct laser_driver sim_laser_driver;
extern const struct interlock_driver sim_interlock_driver;
