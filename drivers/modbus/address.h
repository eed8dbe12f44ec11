/* Names of lines, and the locks (drivers/lock.h) of what is on them. */
#pragma once

#include "drivers/lock.h"

gboolean modbus_is_tcp(const char *bus); /* tcp:HOST:PORT, and not a serial port */

/* The same name for the same line: links to a serial port are resolved, "tcp:LOCALHOST" is
 * "tcp:127.0.0.1:502". Other host names stay as they are: nothing is asked. g_free() */
char *modbus_address_name(const char *bus);

/* "coil 3 of unit 1 at tcp:10.0.0.2:502", for what is "coil" and number 3. g_free() */
char *modbus_address_of(const char *what, int number, const char *bus, int unit);

/* Locks a unit of a board on the network, at all addresses that its host name has; a host that is
 * not known has none. Fails as lock_take() does. Waits for the network's names. The list frees the
 * locks. */
GPtrArray *modbus_address_lock_unit(const char *bus, int unit, GError **error);

/* Who has a unit of a board on the network: as lock_holder(). */
gboolean modbus_address_unit_holder(const char *bus, int unit, pid_t *ret_pid);
