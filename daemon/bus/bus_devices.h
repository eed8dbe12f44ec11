/* The devices of a rig as the bus lists them. */
#pragma once

#include "rig/devices.h"

/* "a(ssss)": class, name, driver, health. faults: names of devices to what is wrong with them
 * (both char *). devices may be NULL: an empty list. Floating. */
GVariant *bus_devices(struct devices *devices, GHashTable *faults);
