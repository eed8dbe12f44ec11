/*
 * GigE Vision and USB3 Vision cameras, through Aravis. The driver works in real time only.
 *
 * The option `device` is an IP address, a serial number, or Aravis's name of the camera. A camera
 * is triggered by its software command, or by a pulse on an input line. A frame is accepted only if
 * the camera's own clock shows that the exposure began after the trigger. If the camera has no
 * clock, the frame must have begun to arrive after the trigger. An older frame is ignored.
 */
#pragma once

#include "drivers/camera.h"

extern const struct camera_driver aravis_camera_driver;

struct aravis_found {
    char *id;       /* Aravis's name of the camera: vendor, model and serial number */
    char *serial;   /* a value for the option "device" that stays valid if the address changes */
    char *address;  /* IP address of a GigE Vision camera; NULL for other cameras */
    char *model;    /* vendor and model, for users */
    char *protocol; /* "GigEVision", "USB3Vision" */
};

/* Returns all cameras of these protocols on the networks and buses of this machine, as struct
 * aravis_found. Free the array with g_ptr_array_unref(). The function blocks for a second and may
 * be called by any thread. */
GPtrArray *aravis_scan(void);
