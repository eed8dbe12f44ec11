/* Serial line operations that libmodbus lacks. They use a second file descriptor of the line. */
#pragma once

#include <glib.h>

/* Opens the line and locks it, so that no other program that locks lines uses it. The caller closes
 * the descriptor. Returns -1 and sets errno on failure; EWOULDBLOCK means that another program has
 * the line. */
int modbus_serial_take(const char *path);

/* Returns the name of the program that has locked the line, such as "mesorigd (process 708)".
 * Returns NULL if the program is not known. Free it with g_free(). */
char *modbus_serial_holder(const char *path);

/* Changes the settings of the line, so that the wanted settings can be set afterwards. Debian's C
 * library returns EINVAL if the wanted settings change nothing but parity, which a pseudo-terminal
 * does not have. Without this call, a pseudo-terminal that a killed program has used could not be
 * opened again. */
void modbus_serial_unsettle(int fd);
