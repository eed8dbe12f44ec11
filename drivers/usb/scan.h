/* Looking for USB devices that drivers here speak to. */
#pragma once

#include "drivers/found.h"

/* See drivers/found.h. Opens no device; reports what the kernel has read from the devices. Leaves
 * out hubs, and cameras, which other scans find. */
gboolean usb_scan(GPtrArray *to, GError **error);
