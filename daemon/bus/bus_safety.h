/*
 * The permit of each device before it gives light or moves, and the list of devices on the bus that
 * have not confirmed that they are off or stand still. All functions belong to the main loop's
 * thread.
 */
#pragma once

#include "bus_private.h"

/* Call it after a rig was opened. From now on no device gives light or moves while the latch is
 * set. No laser of a rig with real devices is switched on unless the guardian has answered within
 * the last second. */
void bus_safety_watch(Bus *bus);

/* Call it after the devices have been closed. */
void bus_safety_forget(Bus *bus);

/* Returns whether all devices are safe. The error is BUS_ERROR_BUSY if a lamp, laser or axis has
 * not confirmed that it is off or stands still. */
gboolean bus_need_safe(Bus *bus, GError **error);
