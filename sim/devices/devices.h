/*
 * Simulated devices: drivers of every class that act on, or look at, a World. They keep real or
 * virtual time, take the times that their options give, and can fail on request; `mesorig drivers`
 * describes every option. An axis is the simplest driver to read before writing another.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

/* Where the load is when a drive with this largest position error stands at deg, without backlash.
 * wraps: deg and deg + 360 are the same. */
double sim_axis_true_deg(double deg, gboolean wraps, double position_error_deg, int error_seed);

/* Until when, on the rig's clock, a device neither obeys nor answers (fault_dead_s); a time that
 * has passed: it does. */
gint64 sim_laser_dead_until_us(const Laser *laser);
gint64 sim_lamps_dead_until_us(const LampBank *bank);

extern const struct axis_driver sim_axis_driver;
extern const struct lamps_driver sim_lamps_driver;
extern const struct camera_driver sim_camera_driver;
extern const struct laser_driver sim_laser_driver;
extern const struct interlock_driver sim_interlock_driver;
