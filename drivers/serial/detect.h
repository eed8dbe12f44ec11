/* Finds out which language a G-code board speaks, for `mesorig new-rig`. */
#pragma once

#include "board.h"

/* Opens a serial port and asks the board for its firmware by M115, at each usual speed. On success
 * sets *ret_dialect, *ret_baud, and *ret_firmware, such as "Marlin 2.1.2", which the caller frees.
 * The answer to M115 of a board with GRBL is an error, by which it is recognised. Opening the port
 * resets most boards; nothing moves. Blocks, for at most 7 s if the port is silent. Any thread may
 * call this function. Returns FALSE with DEVICE_ERROR_BUSY if another program uses the port, with
 * DEVICE_ERROR_DISCONNECTED if it cannot be opened, with DEVICE_ERROR_UNSUPPORTED if the board has
 * another firmware, or with DEVICE_ERROR_TIMEOUT if nothing known is answered. */
gboolean gcode_detect(const char *port, enum gcode_dialect *ret_dialect, int *ret_baud,
                      char **ret_firmware, GError **error);
