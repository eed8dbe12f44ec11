/* Searches for Modbus devices. */
#pragma once

#include "bus.h"

#include "drivers/found.h"

/* Lists the serial ports of this machine. The devices on a port are not known until they are asked.
 * See drivers/found.h. */
gboolean serial_scan(GPtrArray *to, GError **error);

/* Asks each unit from number `first` to number `last` of a line whether it exists. For this the
 * function reads the first register and the first coils of the unit, and changes nothing. If the
 * link has no retries, each unit that does not exist takes timeout_ms + late_ms of the link.
 *
 * The function fails if the line cannot be opened, for example a serial line that another process
 * has open. A unit of a board on the network is asked even if another process uses it; the note of
 * the result then names that process. */
gboolean modbus_scan(const struct modbus_link *link, int first, int last, GPtrArray *to,
                     GError **error);
