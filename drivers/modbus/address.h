/* Names of Modbus lines, and the locks (drivers/lock.h) of the devices on them. */
#pragma once

#include "drivers/lock.h"

/* Returns whether bus is tcp:HOST:PORT rather than a serial port. */
gboolean modbus_is_tcp(const char *bus);

/* Returns the name of a line in one form. Links to a serial port are resolved, and "tcp:LOCALHOST"
 * becomes "tcp:127.0.0.1:502". Other host names stay as they are, because no name server is asked.
 * Free it with g_free(). */
char *modbus_address_name(const char *bus);

/* Returns the name of one thing of a unit. For example, with "coil" for `what` and 3 for `number`,
 * the name is "coil 3 of unit 1 at tcp:10.0.0.2:502". Free it with g_free(). */
char *modbus_address_of(const char *what, int number, const char *bus, int unit);

/* Locks a unit of a board on the network, at all addresses that its host name has. Fails like
 * lock_take(). Waits for the name server. Returns a list that releases the locks when it is freed.
 * The list is empty if the name of the host is not known. */
GPtrArray *modbus_address_lock_unit(const char *bus, int unit, GError **error);

/* Returns whether a process has locked a unit of a board on the network. *ret_pid is the number of
 * that process, as in lock_holder(). If the host name is not known, the function returns FALSE and
 * does not set *ret_pid. */
gboolean modbus_address_unit_holder(const char *bus, int unit, pid_t *ret_pid);
