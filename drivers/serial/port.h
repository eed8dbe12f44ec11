/* A serial port in raw mode: 8 bits, no parity, one stop bit, any speed. */
#pragma once

#include <glib.h>

/* Opens and locks a port, and discards input that was not read. Returns a descriptor that does not
 * block; close it with close(). Returns -1 on failure, with DEVICE_ERROR_BUSY if another program
 * uses the port and DEVICE_ERROR_DISCONNECTED otherwise. The error names the port. On most Arduino
 * boards, opening the port resets the board. */
int serial_port_open(const char *path, int baud, GError **error);
