/* A serial port in raw mode, 8 bits, no parity, one stop bit, at any speed. */
#pragma once

#include <glib.h>

/* Opens and locks a port that does not block. Discards input that was not read. Returns -1 with a
 * DEVICE_ERROR that names the port on failure. Close the descriptor with close(). On most Arduino
 * boards, opening the port resets the board. */
int serial_port_open(const char *path, int baud, GError **error);
