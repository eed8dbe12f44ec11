/* Serial line operations that libmodbus lacks, on a descriptor beside libmodbus's own. */
#pragma once

#include <glib.h>

/* Opens the line and locks it, so that no other program that locks lines uses it. -1 with errno;
 * EWOULDBLOCK: another program has it. The caller closes it. */
int modbus_serial_take(const char *path);

/* The program that has locked it: "mesorigd (process 708)"; NULL: it cannot be told; g_free(). */
char *modbus_serial_holder(const char *path);

/* Changes the settings of the line, so that setting the wanted ones succeeds afterwards. Debian's C
 * library returns EINVAL if the wanted settings change nothing, as for parity on a pseudo-terminal,
 * which has none: a pseudo-terminal that a killed program left behind could not be opened again. */
void modbus_serial_unsettle(int fd);
