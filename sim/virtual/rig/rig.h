/*
 * A whole rig of virtual devices, which speak the real protocols. For each device of a simulated
 * rig, it has a virtual device that a real driver can open.
 *
 * The usual devices:
 * - Axes are Modbus RTU drives on pseudo-terminals.
 * - Lamps, lasers and interlocks are Modbus TCP boards of relays and inputs on the loopback
 *   interface.
 * - Cameras are GigE Vision cameras on the loopback interface.
 *
 * Devices of other kinds (struct virtual_rig_kinds):
 * - On USB buses that umockdev emulates, axes are Pololu Tics, lamps and lasers are connected to
 *   HID relay boards, and cameras are V4L2 or USB3 Vision cameras.
 * - Cameras may be still cameras on PTP/IP.
 * - Axes may be on boards that speak G-code, and lamps on serial LED controllers. These boards and
 *   controllers are on pseudo-terminals.
 *
 * All devices act on the world of the simulated rig or look at it, so the cameras see a lamp that a
 * relay switches. Devices run in separate threads. The main loop, which must run, transfers their
 * motion and light to the world. The thread of a camera that is not a V4L2 camera does the same
 * before it renders a frame.
 */
#pragma once

#include "virtual/cameras/gige.h"
#include "virtual/modbus.h"

#include "base/config.h"

typedef struct VirtualRig VirtualRig;

struct virtual_rig_device {
    char *section; /* section of the rig file: "camera cam15" */
    char *driver;  /* driver that opens the device */
    char *where;   /* address of the device, such as "127.77.4.9" or "/dev/pts/5 unit 1" */
};

/* Names of devices that are not of the usual kind. Each member is an array of names that ends with
 * NULL, or is NULL for no device. The name "all" means all devices that can be of this kind. */
struct virtual_rig_kinds {
    const char *const *usb;   /* devices on USB */
    const char *const *u3v;   /* USB3 Vision cameras; they need not be in usb */
    const char *const *still; /* still cameras on PTP/IP; takes precedence over usb and u3v */
    const char *const *gcode; /* axes on boards that speak GRBL; takes precedence over usb */
    /* lamp banks on serial LED controllers; takes precedence over usb */
    const char *const *serial;
};

/* Makes a rig. path is a rig file that has only drivers of simulated devices. kinds may be NULL. If
 * usb or u3v names a device, the process must have begun with testbed_enter(). Returns NULL with an
 * error if the file is wrong or a device cannot be made. */
VirtualRig *virtual_rig_new(const char *path, const struct virtual_rig_kinds *kinds,
                            GError **error);
void virtual_rig_free(VirtualRig *rig); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualRig, virtual_rig_free)

/* Returns the text of the rig file for the real drivers. Geometry, speeds and names are those of
 * the simulated rig. The rig owns the string. */
const char *virtual_rig_text(const VirtualRig *rig);

/* Returns the environment variables that a program needs to see the rig's USB devices, as
 * "NAME=value NAME=value". Returns NULL if the rig has no USB devices. Free the text with
 * g_free(). */
char *virtual_rig_environment(const VirtualRig *rig);

/* Returns an array of *ret_n devices. The rig owns the array. */
const struct virtual_rig_device *virtual_rig_devices(const VirtualRig *rig, gsize *ret_n);

/* Sets the faults of all GigE Vision and USB3 Vision cameras from now on. */
void virtual_rig_fail_cameras(VirtualRig *rig, const struct virtual_camera_faults *faults);

/* Sets the faults of all Modbus devices from now on. */
void virtual_rig_fail_lines(VirtualRig *rig, const struct virtual_modbus_faults *faults);

/* Disconnects a device, or connects it again. name is the name of its section, such as "cam30" or
 * "camera cam30". Returns FALSE with an error if there is no such device, or if it cannot be
 * disconnected.
 *
 * A board (Modbus or G-code) is disconnected for all sections that share it. For a Modbus device,
 * this also ends the faults of virtual_rig_fail_lines(). A still camera is switched off. Of the
 * devices on USB, only USB3 Vision cameras can be disconnected. */
gboolean virtual_rig_plug(VirtualRig *rig, const char *name, gboolean plugged, GError **error);

/* Changes the sample: from now on, the devices act on the world of this file. The new world must
 * have the same cameras, lamps and lasers as the present world, with the same names and sensors.
 *
 * Returns FALSE with an error if the world is not changed: if the file cannot be loaded or does not
 * fit, if it is the file of the present world, or if the rig has devices on USB other than USB3
 * Vision cameras. */
gboolean virtual_rig_set_world(VirtualRig *rig, const char *path, GError **error);

/* Interrupts the power of a GigE Vision camera for down_ms. name is the name of its section. */
void virtual_rig_restart_camera(VirtualRig *rig, const char *name, int down_ms);

/* `n_lit` is the number of lamps and lasers that are on. `n_moving` is the number of axes that move
 * now. All axes of a board that speaks G-code count as one. */
struct virtual_rig_state {
    int n_lit, n_moving;
};
void virtual_rig_state(VirtualRig *rig, struct virtual_rig_state *ret);
