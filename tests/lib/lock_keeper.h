/* Another process that holds the lock of a device (drivers/lock.h). Errors in these functions fail
 * the test. */
#pragma once

#include "drivers/lock.h"

#include <gio/gio.h>

/* Returns the process, after it has taken the lock. */
GSubprocess *lock_keeper_start(const char *key);
void lock_keeper_end(GSubprocess *keeper);

/* Checks that the error says that the process `keeper` holds the lock of a device, and clears the
 * error. */
void lock_keeper_expect(GSubprocess *keeper, GError **error);
