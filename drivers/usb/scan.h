/* Searches for USB devices, and writes a section for each one that has a driver here. */
#pragma once

#include "drivers/found.h"

/* Lists the USB devices except hubs, video cameras and USB3 Vision cameras; see drivers/found.h.
 * Opens no device: the results are what the kernel has read from the devices. */
gboolean usb_scan(GPtrArray *to, GError **error);
