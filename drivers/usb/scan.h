/* Searches for USB devices, and writes a section for each one that has a driver here. */
#pragma once

#include "drivers/found.h"

/* Lists the devices; see drivers/found.h. Opens no device: the results are what the kernel has read
 * from the devices. Leaves out hubs. Also leaves out cameras, which other scans find. */
gboolean usb_scan(GPtrArray *to, GError **error);
