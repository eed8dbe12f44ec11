/*
 * A virtual USB3 Vision camera behind umockdev's usbfs. Aravis reaches it through libusb, like a
 * real camera. A process sees the camera only after testbed_enter().
 *
 * The camera has bulk endpoints for two channels: a control channel for registers, and a stream
 * channel for leaders, payloads and trailers. It serves its own GenICam file. The pictures come
 * from the function options->picture. Exposures take place in real time, in a separate thread of
 * the camera.
 *
 * Any thread may call these functions, except virtual_u3v_new(), virtual_u3v_free(),
 * virtual_u3v_plug() and virtual_u3v_unplug().
 */
#pragma once

#include "imager.h"
#include "virtual/usb_device.h"

typedef struct VirtualU3v VirtualU3v;

/* Makes a camera that is plugged into a port from 1 to 9 of bus 1. In a rig file, the value of
 * "device" is the camera's serial number. */
VirtualU3v *virtual_u3v_new(const struct virtual_camera_options *options, int port);
void virtual_u3v_free(VirtualU3v *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualU3v, virtual_u3v_free)

const char *virtual_u3v_serial(const VirtualU3v *camera);
VirtualUsb *virtual_u3v_usb(VirtualU3v *camera); /* the device on the bus, for its faults */

void virtual_u3v_fail(VirtualU3v *camera, const struct virtual_camera_faults *faults);

/* Unplug the camera, and plug it in again. The cable powers the camera, so all registers have their
 * initial values afterwards. */
void virtual_u3v_unplug(VirtualU3v *camera);
void virtual_u3v_plug(VirtualU3v *camera);

/* Makes the endpoint of the stream stall until the host clears the stall. */
void virtual_u3v_halt_stream(VirtualU3v *camera);

/* Sends a pulse to the input "Line0". */
void virtual_u3v_pulse(VirtualU3v *camera);

void virtual_u3v_state(VirtualU3v *camera, struct virtual_camera_state *ret);
