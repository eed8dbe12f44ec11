/* Looking for USB devices that drivers here speak to. */
#pragma once

#include "drivers/found.h"

/* See drivers/found.h. Opens no device: what is told is what the kernel has read. Hubs are left
 * out, and so are cameras, which other scans find. */
gboolean usb_scan(GPtrArray *to, GError **error);
