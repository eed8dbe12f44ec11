/*
 * What each device asks before it gives light or moves, and what the bus shows of devices that have
 * not confirmed that they are off or stand. Main loop's thread.
 */
#pragma once

#include "bus_private.h"

/* For a rig that was opened. From now on no device gives light or moves while the latch is set, and
 * no laser of a rig with real devices is switched on unless the guardian has answered within the
 * last second. */
void bus_safety_watch(Bus *bus);

/* The devices have been closed. */
void bus_safety_forget(Bus *bus);

/* Error BUS_ERROR_BUSY: a lamp, laser or axis has not confirmed that it is off or stands. */
gboolean bus_need_safe(Bus *bus, GError **error);
