/* The devices of a rig as the bus lists them. */
#pragma once

#include "rig/devices.h"
#include "session/session.h"

/* "a(ssss)": class, name, driver, health. faults maps the name of a device to its fault, unsafe
 * maps class and name ("laser top") to what the device has not confirmed (all of them char *).
 * devices NULL: an empty list. Floating. */
GVariant *bus_devices(struct devices *devices, GHashTable *faults, GHashTable *unsafe);

/* The values of the properties Pose and Places. shot NULL: none was taken; devices NULL: none are
 * open. Floating. */
GVariant *bus_pose(const struct devices *devices, const struct session_shot *shot);
GVariant *bus_places(const struct devices *devices);
