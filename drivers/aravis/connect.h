/* Finds a camera and takes control of it. All functions block. */
#pragma once

#include <arv.h>

#include "drivers/lock.h"

/* Connects to a camera. `id` is an IP address, Aravis's name of the device, its physical id (the
 * MAC address of a GigE camera), or its serial number. The function waits up to control_s seconds
 * for another program to release the camera. The caller first frees the device (g_object_unref())
 * and then releases *ret_lock (lock_release()). *ret_lock is NULL for a USB camera whose device
 * node was not found. On failure, returns NULL with a DEVICE_ERROR, and *ret_lock is NULL. */
ArvDevice *aravis_connect(const char *id, double control_s, Lock **ret_lock, GError **error);

/* Aravis keeps one list of devices per process. Lock it while you update or read it. */
void aravis_list_lock(void);
void aravis_list_unlock(void);
