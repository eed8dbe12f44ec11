/* A serial port in raw mode: 8 bits, no parity, one stop bit, any speed. */
#pragma once

#include <glib.h>

/* Opens and locks a port, and discards input that was not read. Returns a descriptor that does not
 * block; close it with close(). On most Arduino boards, opening the port resets the board.
 *
 * Returns -1 on failure. The error is DEVICE_ERROR_BUSY if another program uses the port, otherwise
 * DEVICE_ERROR_DISCONNECTED. It names the port. */
int serial_port_open(const char *path, int baud, GError **error);
