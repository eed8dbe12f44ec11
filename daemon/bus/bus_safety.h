/*
 * The permit of each device before it gives light or moves, and the list of devices on the bus that
 * have not confirmed that they are off or stand still. All functions belong to the main loop's
 * thread.
 */
#pragma once

#include "bus_rig.h"

/* Call it after a rig was opened. From now on no device gives light or moves while the latch is
 * set. No laser of a rig with real devices is switched on unless the guardian has answered within
 * the last second. */
void bus_safety_watch(struct bus_rig *rig);

/* Call it after the devices have been closed. */
void bus_safety_forget(struct bus_rig *rig);

/* Returns whether all devices are safe. The error is BUS_ERROR_BUSY if a lamp, laser or axis has
 * not confirmed that it is off or stands still. */
gboolean bus_safety_need(struct bus_rig *rig, GError **error);

/* Returns whether a rig is open and not being closed, no capture is under way, no device is in
 * use by hand, and the latch of the safe state is not set. */
gboolean bus_safety_is_free(const struct bus_rig *rig);

/* Holds the clock (bus_rig_hold_clock()) if no capture is under way, no device is in use by hand,
 * the latch is not set, and every device has confirmed that it is off or stands still. */
void bus_safety_rest_clock(struct bus_rig *rig);
