/* Finds a camera and takes control of it. All functions block. */
#pragma once

#include <arv.h>

#include "drivers/lock.h"

/* Connects to a camera. id is an IP address, Aravis's name of the device, or its serial number.
 * The function waits up to control_s seconds for another program to release the camera. The caller
 * frees the device first and then releases *ret_lock. *ret_lock is NULL for a USB camera whose
 * device node was not found. Returns NULL with a DEVICE_ERROR on failure. */
ArvDevice *aravis_connect(const char *id, double control_s, Lock **ret_lock, GError **error);

/* Aravis keeps one list of devices per process. Lock it while you read it. */
void aravis_list_lock(void);
void aravis_list_unlock(void);
