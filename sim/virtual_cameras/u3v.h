/*
 * A virtual USB3 Vision camera behind umockdev's usbfs, which Aravis reaches through libusb as it
 * does a real one. It has a control channel for registers and a stream channel for leaders,
 * payloads and trailers, on bulk endpoints, and serves its GenICam file itself. The creator
 * supplies its pictures; an exposure takes its real time, in a thread of the camera's own. A
 * process sees it only after testbed_enter().
 *
 * Any thread may call these functions, except new, free, plug and unplug.
 */
#pragma once

#include "imager.h"
#include "virtual/usb_device.h"

typedef struct VirtualU3v VirtualU3v;

/* Plugged into port 1 to 9 of bus 1. Its serial number is what a section writes for "device". */
VirtualU3v *virtual_u3v_new(const struct virtual_camera_options *options, int port);
void virtual_u3v_free(VirtualU3v *camera); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualU3v, virtual_u3v_free)

const char *virtual_u3v_serial(const VirtualU3v *camera);
VirtualUsb *virtual_u3v_usb(VirtualU3v *camera); /* for faults of the bus */

void virtual_u3v_fail(VirtualU3v *camera, const struct virtual_camera_faults *faults);

/* The cable powers it: when it is plugged in again, all registers are as they were at first. */
void virtual_u3v_unplug(VirtualU3v *camera);
void virtual_u3v_plug(VirtualU3v *camera);

/* Its stream's endpoint stalls until the host clears it. */
void virtual_u3v_halt_stream(VirtualU3v *camera);

/* A pulse on its input, "Line0". */
void virtual_u3v_pulse(VirtualU3v *camera);

void virtual_u3v_state(VirtualU3v *camera, struct virtual_camera_state *ret);
