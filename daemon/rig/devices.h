/* The rig that a rig file describes. Every device is opened by its driver, and the same sections
 * give the nominal geometry (geometry/rig.h). The list of drivers is in devices_drivers.c.
 *
 * The sections are:
 * - [rig]
 * - [axis turntable], [axis arc], [axis arm] and [axis probe]; each is optional
 * - [axis NAME] for the sweeps of the lasers; several lasers may share one axis
 * - [lamps BANK], which places its lamps (lamp_places.h) or has a [lamp NAME] for each of them
 * - [camera NAME], [laser NAME]
 * - [interlock NAME] and [mark NAME], which are optional
 *
 * A lamp or laser with phi_deg is fixed at that azimuth. One without phi_deg is carried by [axis
 * arc], or is overhead if there is no such axis. An axis that the rig does not have counts as
 * standing at 0.
 *
 * A camera with arm_deg is carried by the arm, and a lamp with probe_deg by the probe. In geometry
 * and timing, each of their stops is a separate camera or lamp (geometry/rig.h). All stops share
 * the same device.
 *
 * A [laser NAME] with mount_of is not a device. It is a further mount position of the unit that
 * it names, where an operator mounts the unit by hand. In geometry and timing it is a separate
 * laser. */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"
#include "geometry/rig.h"

#define DEVICES_MAX_BANKS      64
#define DEVICES_MAX_INTERLOCKS 4

/* Speeds, delays and limits of the devices, for predicting durations. Each array has the same
 * indices as the devices in struct rig. */
struct rig_timing {
    struct axis_motion turntable, arc, arm, probe, sweep[RIG_MAX_LASERS];
    double lamp_warm_up_s[RIG_MAX_LAMPS];
    double laser_warm_up_s[RIG_MAX_LASERS];
    /* For each laser unit, a bit is set for each laser section that is a further mount position of
     * this unit. */
    guint32 mounts[RIG_MAX_LASERS];
    gint64 trigger_us[RIG_MAX_CAMERAS], readout_us[RIG_MAX_CAMERAS];
    gint64 min_exposure_us[RIG_MAX_CAMERAS], max_exposure_us[RIG_MAX_CAMERAS];
    /* maximum error of the time stamps, as in struct camera_format */
    gint64 stamp_us[RIG_MAX_CAMERAS];
    int bits[RIG_MAX_CAMERAS];
    gboolean listed_exposures[RIG_MAX_CAMERAS]; /* as in struct camera_driver */
};

/* Returns the index of the laser unit that is mounted at the position of a laser section. This is
 * the section itself if it has no mount_of. */
static inline int rig_laser_unit(const struct rig_timing *timing, int laser) {
    for (int unit = 0; unit < RIG_MAX_LASERS; unit++)
        if (timing->mounts[unit] & 1u << laser)
            return unit;
    return laser;
}

struct devices {
    Clock *clock;
    struct rig geometry; /* nominal, from the rig file */
    struct rig_timing timing;
    Axis *turntable, *arc, *arm, *probe; /* NULL if the rig has no such axis */
    /* In the order of geometry.cameras; several stops share one camera. */
    Camera *cameras[RIG_MAX_CAMERAS];
    LampBank *banks[DEVICES_MAX_BANKS];
    int n_banks;
    struct {
        LampBank *bank; /* an element of banks */
        int index;
    } lamps[RIG_MAX_LAMPS]; /* in the order of geometry.lamps */
    /* In the order of geometry.lasers; a mount position has the laser of its unit. */
    Laser *lasers[RIG_MAX_LASERS];
    Axis *sweeps[RIG_MAX_LASERS]; /* the sweep axis of each laser */
    Interlock *interlocks[DEVICES_MAX_INTERLOCKS];
    int n_interlocks;
    /* an interlock that stands for all interlocks of the rig and guards the lasers; NULL if the rig
     * has no interlock */
    Interlock *guard;
    /* The rig file as it was read. Lamps with positions in another file are written as sections
     * [lamp NAME] instead. */
    char *text;
    char *path; /* absolute path of the rig file */
    /* Absolute path of the calibration that the rig file names; NULL if it names none. */
    char *calibration_path;
    /* contents of the calibration, not owned; NULL if the file has to be read */
    const char *calibration_text;
    double calibration_days;
};

/* Returns the axis with index i in the order turntable, arc, arm, probe. These are all axes except
 * the sweeps of lasers. Returns NULL if the rig does not have this axis. */
#define DEVICES_POSITIONERS 4
static inline Axis *devices_positioner(const struct devices *devices, int i) {
    Axis *const all[DEVICES_POSITIONERS] = {devices->turntable, devices->arc, devices->arm,
                                            devices->probe};
    return all[i];
}

/* Returns whether a camera of the geometry is a separate device, and not a further stop of a camera
 * before it. */
static inline gboolean devices_is_unit(const struct rig *rig, int camera) {
    return rig->cameras[camera].stop == 0;
}

/* Opens all devices. If one fails, none is left open. Moves no axis; lamps and lasers are off
 * afterwards. Returns NULL with an error that names the file and the line. */
struct devices *devices_open(const char *rig_path, GError **error);

/* Fails if the rig file, or a file with positions that it names, has changed since the devices were
 * opened. A rig file that does not exist any more counts as unchanged. */
gboolean devices_check_file(const struct devices *devices, GError **error);

/* Reads only the geometry from the rig file, and opens no device. Whether the options of one driver
 * fit each other is not checked. */
gboolean devices_read_geometry(const char *rig_path, struct rig *ret, GError **error);
/* Reads geometry and timing from the options of the rig file into *ret_geometry and *ret_timing,
 * for a plan without the hardware. No real device is opened. Values that only an open device can
 * report are assumed. A line about each assumption is appended to assumed (of char *, with a free
 * function). */
gboolean devices_read_timing(const char *rig_path, struct rig *ret_geometry,
                             struct rig_timing *ret_timing, GPtrArray *assumed, GError **error);
/* Reads the geometry from the text of a rig file that a session keeps. path is used in errors. */
gboolean devices_parse_geometry(const char *text, const char *path, struct rig *ret,
                                GError **error);

/* Returns whether every device is simulated. The rig's clock may be real or virtual. */
gboolean devices_are_simulated(const struct devices *devices);

/* Switches lamps and lasers off, stops the axes and closes all devices. NULL is ignored. */
void devices_close(struct devices *devices);

/* Commands the safe state now: all lamps and lasers off, all axes stopped. Every device is
 * commanded, even if others fail. Does not wait for their answers. If devices could not be
 * commanded, returns FALSE with one error that has the messages of all of them. */
gboolean devices_make_safe(struct devices *devices, GError **error);

/* Returns the present result of devices_make_safe() as a(sss), floating. Each laser, lamp bank and
 * axis has an entry with its class, its name, and "read back", "commanded only" (no answer yet) or
 * "NOT safe". For a device that cannot be read back, the text of driver_info.confirmed replaces
 * "read back".
 *
 * *ret is DEVICE_TOLD if a device has not answered yet. Otherwise it is DEVICE_UNSAFE if a device
 * is unsafe, and DEVICE_SAFE if none is. */
GVariant *devices_safety(const struct devices *devices, enum device_safety *ret);

/* Set the permit and the watch function (drivers/device.h) of each axis, lamp bank and laser. */
void devices_set_permit(struct devices *devices, DevicePermit permit, gpointer data);
void devices_watch_safety(struct devices *devices, DeviceSafetyFunc func, gpointer data);
/* Returns the identity that each device reports, with its class and name: “camera cam30: MODEL,
 * serial number 7” (char *, with a free function). Interlocks and cameras are included. Devices
 * that report nothing are left out. All devices must be open. */
GPtrArray *devices_identities(const struct devices *devices);
/* Returns whether any device is unsafe: an axis that has not confirmed that it stands, or a lamp
 * bank or laser that has not confirmed that it is off. */
gboolean devices_any_unsafe(const struct devices *devices);

/* Commands the safe state, and waits until every device has confirmed it. Lasers and lamps must
 * confirm that they are off, axes that they stand still. This includes axes that another program
 * has started. Returns FALSE with an error if a device reports a failure or has not confirmed
 * this within 20 s. Runs the main loop, and removes the listeners of all lasers, lamps and axes. */
gboolean devices_secure(struct devices *devices, GError **error);

/* Beginning of a reason or an event that reports that lamps, lasers or axes may not be safe. */
#define DEVICES_UNSAFE "THE RIG COULD NOT BE MADE SAFE"

/* Describes the driver or the section of the rig file with this name and its options, for `mesorig
 * drivers`. Returns NULL if there is no driver or section with the name. If name is NULL, the text
 * has one line for each driver and section; as JSON it has all options. Free it with g_free(). */
char *devices_describe_drivers(const char *name, gboolean json);

/* Returns the driver with index i in the list of all drivers, which is ordered by class. Returns
 * NULL if i is too large. */
const struct driver_info *devices_driver(gsize i);

/* Returns the option table of [rig], [lamp NAME] or [mark NAME]. For a section of axis, lamps,
 * camera or laser, returns the table of the keys that do not belong to the driver. Returns NULL for
 * other classes. */
const struct option *devices_section_options(const char *class_name);
