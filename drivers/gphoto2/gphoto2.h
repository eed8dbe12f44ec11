/*
 * DSLR and mirrorless cameras, by libgphoto2. The library may wait for ever inside a call, and only
 * the end of its process ends this wait. Therefore each camera has a process of its own,
 * mesorig-gphoto2, which the driver runs as a program that is a device (program/camera.h). The
 * functions here belong to the main loop's thread.
 */
#pragma once

#include "drivers/camera.h"
#include "drivers/found.h"

extern const struct camera_driver gphoto2_camera_driver;

/* Finds cameras on USB, by mesorig-gphoto2, and adds them to the array (of struct found). If the
 * array already has a USB device with the address of a camera, this device gets the section of the
 * camera instead. Waits up to 5 s. Fails with G_IO_ERROR_TIMED_OUT if the program takes longer,
 * with G_IO_ERROR_FAILED if the program ends with an error, and with other errors if the program is
 * missing or cannot be started. */
gboolean gphoto2_scan(GPtrArray *to, GError **error);
