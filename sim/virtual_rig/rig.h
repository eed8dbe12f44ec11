/*
 * A whole rig of virtual devices that speak the real protocols, on loopback: for each device of a
 * simulated rig it has one that a real driver opens. Axes are Modbus RTU drives on
 * pseudo-terminals, lamps, lasers and interlocks are Modbus TCP relay boards and inputs, cameras
 * are GigE Vision; or else axes are Pololu Tics, lamps and lasers hang on HID relay boards, and
 * cameras are V4L2's or USB3 Vision's, all on USB buses that umockdev emulates. All act on, or look
 * at, the world of that rig, so that a lamp switched by a relay is seen by the cameras.
 *
 * Devices run in threads of their own; the main loop, which must run, transfers their motion and
 * light to the world, and so does every frame before it is rendered.
 */
#pragma once

#include "virtual/modbus.h"
#include "virtual_cameras/gige.h"

#include "base/config.h"

typedef struct VirtualRig VirtualRig;

struct virtual_rig_device {
    char *section; /* of the rig file: "camera cam15" */
    char *driver;  /* driver that opens it */
    char *where;   /* "127.77.4.9", "/dev/pts/5 unit 1" */
};

/* path: a rig file whose drivers are all simulated. usb: the names of the devices that are to be on
 * USB, or "all"; NULL for none. u3v: likewise, the cameras that are to be USB3 Vision's, which need
 * not be in usb. If either names a device, the process must have begun with testbed_enter(). Errors
 * name what is wrong with the file. */
VirtualRig *virtual_rig_new(const char *path, const char *const *usb, const char *const *u3v,
                            GError **error);
void virtual_rig_free(VirtualRig *rig); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualRig, virtual_rig_free)

/* The rig file for the real drivers: geometry, speeds and names as in the other. Owned by rig. */
const char *virtual_rig_text(const VirtualRig *rig);

/* The variable that a program needs in its environment to see the rig's USB devices, as
 * "NAME=value"; NULL if the rig has none; g_free(). */
char *virtual_rig_environment(const VirtualRig *rig);

/* Returns an array of *ret_n devices. The rig owns it. */
const struct virtual_rig_device *virtual_rig_devices(const VirtualRig *rig, gsize *ret_n);

/* Sets the faults of all cameras from now on. */
void virtual_rig_fail_cameras(VirtualRig *rig, const struct virtual_camera_faults *faults);

/* Sets the faults of all Modbus devices from now on. */
void virtual_rig_fail_lines(VirtualRig *rig, const struct virtual_modbus_faults *faults);

/* Disconnects a device, or connects it again. name: that of its section, "cam30" or "camera cam30".
 * A Modbus board goes with all sections that share it. Of the devices on USB, only USB3 Vision
 * cameras can be disconnected. */
gboolean virtual_rig_plug(VirtualRig *rig, const char *name, gboolean plugged, GError **error);

/* Another sample: the devices act on the world of this file from now on. Its cameras, lamps and
 * lasers must have the names and sensors of the present one; a rig with devices on USB other than
 * USB3 Vision cameras keeps its world. */
gboolean virtual_rig_set_world(VirtualRig *rig, const char *path, GError **error);

/* Interrupts the power of a GigE Vision camera. name: of its section. */
void virtual_rig_restart_camera(VirtualRig *rig, const char *name, int down_ms);

/* Returns which lights shine and which axes move now. */
struct virtual_rig_state {
    int n_lit, n_moving;
};
void virtual_rig_state(VirtualRig *rig, struct virtual_rig_state *ret);
