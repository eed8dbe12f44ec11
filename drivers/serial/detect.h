/* Finds out which language a G-code board speaks, for `mesorig new-rig`. */
#pragma once

#include "board.h"

/* Opens a serial port and asks the board for its firmware by M115, at each usual speed. On success
 * sets *ret_dialect, *ret_baud and *ret_firmware, such as "Marlin 2.1.2". The caller frees
 * *ret_firmware. A board with GRBL is recognised by the error with which it answers M115.
 *
 * Opening the port resets most boards; nothing moves. Blocks, for at most 7 s if the port is
 * silent. Any thread may call this function.
 *
 * Returns FALSE with an error:
 * - DEVICE_ERROR_BUSY: another program uses the port
 * - DEVICE_ERROR_DISCONNECTED: the port cannot be opened
 * - DEVICE_ERROR_UNSUPPORTED: the board has another firmware
 * - DEVICE_ERROR_TIMEOUT: there is no answer, or only unknown ones */
gboolean gcode_detect(const char *port, enum gcode_dialect *ret_dialect, int *ret_baud,
                      char **ret_firmware, GError **error);
