/* Another process that holds the lock of a device (drivers/lock.h). Errors in these functions fail
 * the test. */
#pragma once

#include "drivers/lock.h"

/* Returns the process, after it has taken the lock. */
pid_t lock_keeper_start(const char *key);
void lock_keeper_end(pid_t keeper);

/* Checks that the error says that this process holds the lock of a device, and clears the error. */
void lock_keeper_expect(pid_t keeper, GError **error);
