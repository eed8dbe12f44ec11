/* Looking for Modbus devices. */
#pragma once

#include "bus.h"

#include "drivers/found.h"

/* Serial ports of this machine. The devices on a port are not known before they are asked. See
 * drivers/found.h. */
gboolean serial_scan(GPtrArray *to, GError **error);

/* Asks the units first to last of a line whether they are there, by reading their first register
 * and coils: nothing is changed. Waits link->timeout_ms for each that is not. Fails if the line
 * cannot be opened; a serial line that another process has open is such a line. A unit of a board
 * on the network is asked all the same, and the note says who uses it. */
gboolean modbus_scan(const struct modbus_link *link, int first, int last, GPtrArray *to,
                     GError **error);
