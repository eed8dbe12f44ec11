/*
 * Decides for each device whether it may now give light or move. Keeps the list, which clients see,
 * of devices that have not confirmed that they are off or stand still. All functions belong to the
 * main loop's thread.
 */
#pragma once

#include "bus_rig.h"

/* Call this after a rig was opened. From now on no device gives light or moves while the latch is
 * set. If the rig has real devices, a laser is switched on only if the guardian has answered within
 * the last second. */
void bus_safety_watch(struct bus_rig *rig);

/* Call it after the devices have been closed. */
void bus_safety_forget(struct bus_rig *rig);

/* Returns TRUE if all devices are safe. Returns FALSE with BUS_ERROR_BUSY if a lamp, laser or axis
 * has not confirmed that it is off or stands still. */
gboolean bus_safety_need(struct bus_rig *rig, GError **error);

/* Returns whether a rig is open and not being closed, no capture is under way, no device is in
 * use by hand, and the latch of the safe state is not set. */
gboolean bus_safety_is_free(const struct bus_rig *rig);

/* Stops the clock of a simulated rig (bus_rig_hold_clock()) if all of these hold: no capture is
 * under way, no device is in use by hand, the latch is not set, and every device has confirmed that
 * it is off or stands still. */
void bus_safety_rest_clock(struct bus_rig *rig);
