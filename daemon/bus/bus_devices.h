/* The devices of a rig in the form in which the bus lists them. */
#pragma once

#include "rig/devices.h"
#include "session/session.h"

/* Returns the devices as "a(ssss)": class, name, driver, health. The result is floating. If devices
 * is NULL, the list is empty.
 *
 * Keys and values of the two tables are char *. faults maps the name of a device to its fault.
 * unsafe maps class and name, such as "laser top", to the state that the device has not
 * confirmed. */
GVariant *bus_devices(struct devices *devices, GHashTable *faults, GHashTable *unsafe);

/* Return the values of the properties Pose and Places. shot is the last shot, or NULL if no shot
 * was taken. devices is NULL if no rig is open. The results are floating. */
GVariant *bus_pose(const struct devices *devices, const struct session_shot *shot);
GVariant *bus_places(const struct devices *devices);
