/*
 * GigE Vision and USB3 Vision cameras, through Aravis. In real time only.
 *
 * `device` is an IP address, a serial number, or what Aravis calls the camera. A camera is
 * triggered by its software command, or by a pulse on an input line. A frame is taken only if the
 * camera's own clock says that it was exposed after its trigger; an older one is ignored.
 */
#pragma once

#include "drivers/camera.h"

extern const struct camera_driver aravis_camera_driver;

struct aravis_found {
    char *id;       /* the name that Aravis gives it: vendor, model and serial number */
    char *serial;   /* value for the option "device" that stays valid if the address changes */
    char *address;  /* IP address of a GigE Vision camera; else NULL */
    char *model;    /* vendor and model, for people */
    char *protocol; /* "GigEVision", "USB3Vision" */
};

/* All cameras of these protocols on the networks and buses of this machine, as struct aravis_found,
 * to be freed with g_ptr_array_unref(). Blocks for a second; any thread. */
GPtrArray *aravis_scan(void);
