/* The state and the functions that the parts of a virtual rig share. rig.c has the GigE Vision,
 * USB3 Vision and still cameras and the Modbus devices. rig_usb.c has the V4L2 cameras and the
 * other USB devices. rig_gcode.c has the axes on G-code boards, and rig_leds.c has the lamps on
 * serial LED controllers. rig_hands.c has what a person does to the rig. */
#pragma once

#include "rig.h"
#include "virtual/cameras/ptpip.h"
#include "virtual/cameras/u3v.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/gcode.h"
#include "virtual/leds.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"
#include "virtual/world_link.h"
#include "world/world_private.h"

#include "drivers/device.h"

#define MAX_COILS   VIRTUAL_MODBUS_BITS
#define MAX_DEVICES 64
/* number of ports of the virtual bus; each Tic and each relay board occupies one */
#define MAX_USB 9

struct drive {
    VirtualModbus *device;
    struct world_part part;
    gboolean wraps;
    double home_deg, error_deg;
    int error_seed;
    double was_deg; /* position at the time was_us; was_us is 0 before the first measurement */
    gint64 was_us;
};

struct gcode_drive {
    VirtualGcode *board; /* board of up to VIRTUAL_GCODE_AXES axes */
    int axis;
    struct world_part part;
    gboolean wraps;
    double home_deg, error_deg;
    int error_seed;
    double was_deg; /* as in struct drive */
    gint64 was_us;
};

struct led_bank { /* lamps on a serial LED controller */
    VirtualLeds *leds;
    struct world_part parts[VIRTUAL_LEDS_MAX]; /* parts by lamp */
    gboolean on[VIRTUAL_LEDS_MAX];
    int n;
};

struct board { /* board of relays and inputs */
    VirtualModbus *device;
    struct world_part parts[MAX_COILS]; /* parts by coil */
    gboolean on[MAX_COILS];
    int n_coils, n_inputs;
};

struct vision_camera { /* camera on the network or on USB */
    VirtualRig *rig;
    const char *name; /* name of its section */
    int camera;
    VirtualGige *gige;
    VirtualU3v *u3v;
    VirtualPtpip *still;
};

struct VirtualRig {
    Config *config;
    char **usb;    /* names of the devices on USB */
    char **u3v;    /* names of the USB3 Vision cameras */
    char **still;  /* names of the still cameras */
    char **gcode;  /* names of the axes on G-code boards */
    char **serial; /* names of the lamp banks on serial LED controllers */
    World *world;
    GString *text;
    GArray *devices; /* of struct virtual_rig_device */
    struct drive drives[MAX_DEVICES];
    struct board boards[MAX_DEVICES];
    struct gcode_drive gcode_drives[MAX_DEVICES];
    VirtualGcode *gcode_boards[MAX_DEVICES / VIRTUAL_GCODE_AXES + 1];
    int n_gcode_axes;
    struct led_bank led_banks[MAX_DEVICES];
    int n_led_banks;
    struct vision_camera cameras[WORLD_MAX_CAMERAS];
    VirtualTic *tics[MAX_USB];
    /* Boards of USB relays. All lasers are on the board `switches`, which is also an element of
     * `relays`. */
    VirtualRelays *relays[MAX_USB], *switches;
    VirtualV4l2 *videos[WORLD_MAX_CAMERAS];
    int n_drives, n_boards, n_cameras, n_tics, n_relays, n_switched, n_videos, n_u3v;
    struct virtual_camera_faults camera_faults; /* faults of the cameras that are plugged in */
    struct board *power;                        /* board that all lasers and interlocks share */
    GMutex coupling;
    guint timer;
};

/* Returns the value of a key of the section as a number, or the default of the option. Returns 0 if
 * the section has no such key and the option has no default. */
double rig_number(const struct config_section *section, const struct driver_info *driver,
                  const char *key);
const char *rig_part(const struct config_section *section);
gboolean rig_wraps(const struct config_section *section);
void rig_set_error(GError **error, const struct config_section *section, const char *what);

/* Returns the world that a section names. The rig owns the world. Returns NULL with an error if the
 * section names no world, if it names a different world than other sections, or if the world cannot
 * be loaded. */
World *rig_world(VirtualRig *rig, const struct config_section *section, GError **error);
/* Returns the names of the lamps that a bank switches, in order. Sets *ret_n to their number. Free
 * the names with g_strfreev(). */
char **rig_lamps(VirtualRig *rig, const struct config_section *section, int *ret_n);
/* Returns the name that world_part_find() needs for the part that an axis moves. Free the name with
 * g_free(). */
char *rig_axis_part(const struct config_section *section);

/* These functions copy a section without the keys that only the simulated driver accepts.
 * rig_copy_motion() copies the section of an axis. It adds speed and acceleration if the section
 * does not have them. */
void rig_copy_section(VirtualRig *rig, const struct config_section *section,
                      const struct driver_info *from, const struct driver_info *to);
void rig_copy_motion(VirtualRig *rig, const struct config_section *section,
                     const struct driver_info *to);

/* Adds a device to rig->devices. Takes ownership of where. */
void rig_list_device(VirtualRig *rig, const struct config_section *section, const char *driver,
                     char *where);

gboolean rig_is_still(const VirtualRig *rig, const struct config_section *section);
gboolean rig_is_u3v(const VirtualRig *rig, const struct config_section *section);
gboolean rig_is_usb(const VirtualRig *rig, const struct config_section *section);
gboolean rig_check_usb(const VirtualRig *rig, GError **error);
gboolean rig_is_gcode(const VirtualRig *rig, const struct config_section *section);
gboolean rig_add_gcode(VirtualRig *rig, const struct config_section *section, GError **error);
void rig_couple_gcode(VirtualRig *rig);
/* Unplugs the board at a place (`where` of struct virtual_rig_device), or plugs it in. Returns
 * FALSE if no board is at this place. */
gboolean rig_plug_gcode(VirtualRig *rig, const char *where, gboolean plugged);
void rig_add_gcode_state(VirtualRig *rig, struct virtual_rig_state *to);
void rig_free_gcode(VirtualRig *rig);
gboolean rig_is_serial(const VirtualRig *rig, const struct config_section *section);
gboolean rig_add_leds(VirtualRig *rig, const struct config_section *section, GError **error);
void rig_couple_leds(VirtualRig *rig);
/* Does the same as rig_plug_gcode() for a serial LED controller. */
gboolean rig_plug_leds(VirtualRig *rig, const char *where, gboolean plugged);
void rig_add_leds_state(VirtualRig *rig, struct virtual_rig_state *to);
void rig_free_leds(VirtualRig *rig);
gboolean rig_add_tic(VirtualRig *rig, const struct config_section *section, GError **error);
gboolean rig_add_usb_lamps(VirtualRig *rig, const struct config_section *section, GError **error);
gboolean rig_add_usb_laser(VirtualRig *rig, const struct config_section *section, GError **error);
gboolean rig_add_video(VirtualRig *rig, const struct config_section *section, GError **error);
void rig_add_usb_state(const VirtualRig *rig, struct virtual_rig_state *to);
void rig_free_usb(VirtualRig *rig);
