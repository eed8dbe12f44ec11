/* Finding a camera and taking control of it. Blocks. */
#pragma once

#include <arv.h>

#include "drivers/lock.h"

/* id: an IP address, or what Aravis calls the device, or its serial number. Waits up to control_s
 * for another program to release it. The lock is to be released after the device is; NULL: a USB
 * camera whose node is not found. Errors are DEVICE_ERROR. */
ArvDevice *aravis_connect(const char *id, double control_s, Lock **ret_lock, GError **error);

/* Aravis has one list of devices per process: lock it while it is read. */
void aravis_list_lock(void);
void aravis_list_unlock(void);
