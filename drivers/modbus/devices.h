/*
 * Devices on a Modbus line (bus.h). Their sections describe them completely; presets for drives on
 * the market are in etc/devices. They work in real time only.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

extern const struct axis_driver modbus_axis_driver;        /* a positioning drive */
extern const struct lamps_driver modbus_relays_driver;     /* coils of a relay board */
extern const struct laser_driver modbus_laser_driver;      /* one coil */
extern const struct interlock_driver modbus_inputs_driver; /* a discrete input */
