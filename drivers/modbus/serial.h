/* Of serial lines, what libmodbus leaves out. A descriptor of one's own, beside libmodbus's. */
#pragma once

#include <glib.h>

/* Opens the line and takes it for this program, so that no other that asks so speaks on it. -1 with
 * errno; EWOULDBLOCK: another has it. To be closed. */
int modbus_serial_take(const char *path);

/* Sets it to anything else than what is wanted. A pseudo-terminal has no parity, and Debian's C
 * library calls a setting that changed nothing EINVAL: so that one that a killed program left
 * behind could not be opened again. */
void modbus_serial_unsettle(int fd);
