/* Another process that has the lock of a device (drivers/lock.h). What goes wrong in here fails the
 * test. */
#pragma once

#include "drivers/lock.h"

/* Returns once that process has the lock. */
pid_t lock_keeper_start(const char *key);
void lock_keeper_end(pid_t keeper);

/* Fails unless the error is that of a device whose lock that process has; clears it. */
void lock_keeper_expect(pid_t keeper, GError **error);
