/*
 * The rig as its file describes it. Every device is opened through its driver, and the same
 * sections give the nominal geometry (geometry/rig.h). The arrays of drivers are in devices.c.
 *
 * The sections are [rig]; [axis turntable], [axis arc], [axis arm] and [axis probe], each of which
 * is optional; one further axis for the sweep of each laser; [lamps BANK] and a [lamp NAME] for
 * each lamp in it; [camera NAME]; [laser NAME]; [interlock NAME] and [mark NAME], which are
 * optional.
 *
 * A lamp or laser with phi_deg is fixed at that azimuth. One without phi_deg is carried by the arc.
 * An axis that the rig lacks has the position 0.
 *
 * A camera with arm_deg is carried by the arm, and a lamp with probe_deg by the probe. In geometry
 * and timing, each of their stops is a separate camera or lamp (geometry/rig.h). All stops share
 * the same device.
 *
 * A [laser NAME] with mount_of is not a device. It is a further mount position of the unit that it
 * names, where an operator mounts the unit by hand. In geometry and timing it is a separate laser.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"
#include "geometry/rig.h"

#define DEVICES_MAX_BANKS      8
#define DEVICES_MAX_INTERLOCKS 4

/* Speeds, delays and limits of the devices, for predicting durations. Indices are those of struct
 * rig. */
struct rig_timing {
    struct axis_motion turntable, arc, arm, probe, sweep[RIG_MAX_LASERS];
    double lamp_warm_up_s[RIG_MAX_LAMPS];
    double laser_warm_up_s[RIG_MAX_LASERS];
    /* For each laser unit, a bit is set for each laser section that is a further mount position of
     * this unit. */
    guint32 mounts[RIG_MAX_LASERS];
    gint64 trigger_us[RIG_MAX_CAMERAS], readout_us[RIG_MAX_CAMERAS];
    gint64 min_exposure_us[RIG_MAX_CAMERAS], max_exposure_us[RIG_MAX_CAMERAS];
    gint64 stamp_us[RIG_MAX_CAMERAS]; /* as in struct camera_format */
    int bits[RIG_MAX_CAMERAS];
};

/* Returns the index of the laser unit that is mounted at a laser's position (see mount_of). */
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
        LampBank *bank; /* one of banks */
        int index;
    } lamps[RIG_MAX_LAMPS]; /* in the order of geometry.lamps */
    /* In the order of geometry.lasers; a mount position has the laser of its unit. */
    Laser *lasers[RIG_MAX_LASERS];
    Axis *sweeps[RIG_MAX_LASERS]; /* the sweep of each laser */
    Interlock *interlocks[DEVICES_MAX_INTERLOCKS];
    int n_interlocks;
    Interlock *guard; /* guards the lasers on behalf of all interlocks; NULL if there is none */
    char *text;       /* the rig file as it was read */
    char *path;       /* absolute path of the rig file */
    /* Path that the rig file names, absolute; NULL if it names none. */
    char *calibration_path;
    const char *calibration_text; /* contents of that file, not owned; NULL if it has to be read */
    double calibration_days;
};

/* Returns the i-th axis that is not a laser's sweep: turntable, arc, arm, probe. Returns NULL if
 * the rig lacks it. */
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
 * afterwards. Every error names file, line and key. */
struct devices *devices_open(const char *rig_path, GError **error);

/* Reads only the geometry, with the same checks, and opens no device. */
gboolean devices_read_geometry(const char *rig_path, struct rig *ret, GError **error);
/* Reads geometry and timing from the options of the rig file, for a plan without the hardware. No
 * real device is opened. Values that only an open device can report are assumed. A line about each
 * of them is appended to assumed (char *, with a free function). */
gboolean devices_read_timing(const char *rig_path, struct rig *ret_geometry,
                             struct rig_timing *ret_timing, GPtrArray *assumed, GError **error);
/* Reads the geometry from the text of a rig file that a session keeps. path is used in errors. */
gboolean devices_parse_geometry(const char *text, const char *path, struct rig *ret,
                                GError **error);

/* Returns whether every device is simulated. The clock does not matter. */
gboolean devices_are_simulated(const struct devices *devices);

/* Switches lamps and lasers off, stops the axes and closes all devices. NULL is ignored. */
void devices_close(struct devices *devices);

/* Commands the safe state now: all lamps and lasers off, all axes stopped. Every device is
 * commanded, even if others fail. The first error is returned. */
gboolean devices_make_safe(struct devices *devices, GError **error);

/* Returns the result of devices_make_safe() as a(sss), floating: for each laser, lamp bank and axis
 * its class, its name, and "read back", "commanded only" (no answer yet) or "NOT safe". *ret is
 * DEVICE_TOLD if a device has not answered, otherwise DEVICE_UNSAFE if a device is unsafe,
 * otherwise DEVICE_SAFE. */
GVariant *devices_safety(const struct devices *devices, enum device_safety *ret);

/* Set the permit and the watch function (drivers/device.h) of each axis, lamp bank and laser. */
void devices_set_permit(struct devices *devices, DevicePermit permit, gpointer data);
void devices_watch_safety(struct devices *devices, DeviceSafetyFunc func, gpointer data);
/* Returns the identity that each device reports, with its class and name: “camera cam30: MODEL,
 * serial number 7” (char *, with a free function). Interlocks and cameras are included. Devices
 * that report nothing are left out. All devices must be open. */
GPtrArray *devices_identities(const struct devices *devices);
/* Returns whether an axis, lamp bank or laser has not confirmed that it stands or is off. */
gboolean devices_any_unsafe(const struct devices *devices);

/* Commands the safe state, and waits until every device has confirmed it. Lasers and lamps must
 * confirm that they are off, axes that they stand still. This includes axes that another program
 * has started. Returns FALSE if at least one device has not confirmed. Runs the main loop, and
 * removes all other listeners from the devices. */
gboolean devices_secure(struct devices *devices, GError **error);

/* Beginning of a reason or an event that reports that lamps, lasers or axes may not be safe. */
#define DEVICES_UNSAFE "THE RIG COULD NOT BE MADE SAFE"

/* Describes the driver, or the section of the rig file, of this name with its options, for `mesorig
 * drivers`. Returns NULL if there is none of that name. If name is NULL, the text has one line for
 * each driver and section; as JSON it has all options. Free it with g_free(). */
char *devices_describe_drivers(const char *name, gboolean json);

/* Returns the i-th of all drivers, ordered by class. Returns NULL if there are no more. */
const struct driver_info *devices_driver(gsize i);

/* Returns the keys of [rig], [lamp NAME] and [mark NAME], and the keys of camera and laser sections
 * that do not belong to the driver. Returns NULL if the class has none. */
const struct option *devices_section_options(const char *class_name);
