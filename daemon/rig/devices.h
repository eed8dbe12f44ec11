/*
 * The rig as its file describes it: every device opened through its driver, and the nominal
 * geometry (geometry/rig.h) that the same sections give. The visible arrays of drivers are in
 * devices.c.
 *
 * Sections: [rig]; [axis turntable], [axis arc], [axis arm] and [axis probe], each of which a rig
 * may lack, and one further axis for the sweep of each laser; [lamps BANK] and a [lamp NAME] for
 * each lamp in it; [camera NAME]; [laser NAME]; [interlock NAME] and [mark NAME], optional.
 *
 * A lamp or laser with phi_deg stands by itself at that azimuth, one without is carried by the arc.
 * An axis that is not there stands at 0.
 *
 * A camera with arm_deg is carried by the arm, a lamp with probe_deg by the probe. In geometry and
 * timing each of their stops is a camera or lamp like any other (geometry/rig.h); all of them are
 * the same device.
 *
 * A [laser NAME] with mount_of is not a device but a further mount position of the unit that it
 * names, where an operator mounts it by hand. In geometry and timing it is a laser like any other.
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

/* Speeds and delays of the devices, for the prediction of times. Indices as in struct rig. */
struct rig_timing {
    struct axis_motion turntable, arc, arm, probe, sweep[RIG_MAX_LASERS];
    double lamp_warm_up_s[RIG_MAX_LAMPS];
    double laser_warm_up_s[RIG_MAX_LASERS];
    guint32 mounts[RIG_MAX_LASERS]; /* bit set: the laser sections that are further mount positions
                                       of this unit */
    gint64 trigger_us[RIG_MAX_CAMERAS], readout_us[RIG_MAX_CAMERAS];
    gint64 min_exposure_us[RIG_MAX_CAMERAS], max_exposure_us[RIG_MAX_CAMERAS];
    gint64 stamp_us[RIG_MAX_CAMERAS]; /* as in struct camera_format */
    int bits[RIG_MAX_CAMERAS];
};

/* Index of the laser unit that is mounted at a laser's position (see mount_of). */
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
    Axis *turntable, *arc, *arm, *probe; /* NULL: the rig has none */
    Camera *cameras[RIG_MAX_CAMERAS];    /* as geometry.cameras; one at several stops */
    LampBank *banks[DEVICES_MAX_BANKS];
    int n_banks;
    struct {
        LampBank *bank; /* one of banks */
        int index;
    } lamps[RIG_MAX_LAMPS];        /* as geometry.lamps */
    Laser *lasers[RIG_MAX_LASERS]; /* as geometry.lasers; a mount's is its unit's */
    Axis *sweeps[RIG_MAX_LASERS];  /* the sweep of each */
    Interlock *interlocks[DEVICES_MAX_INTERLOCKS];
    int n_interlocks;
    Interlock *guard; /* stands for all of them: what guards the lasers; NULL if there is none */
    char *text;       /* the rig file as it was read */
    char *path;       /* of the rig file, absolute */
    char *calibration_path;       /* the one that the rig file names, absolute; NULL: none */
    const char *calibration_text; /* its contents; NULL: to be read. Not owned. */
    double calibration_days;
};

/* The axes that are no laser's sweep: turntable, arc, arm, probe. NULL: the rig has none. */
#define DEVICES_POSITIONERS 4
static inline Axis *devices_positioner(const struct devices *devices, int i) {
    Axis *const all[DEVICES_POSITIONERS] = {devices->turntable, devices->arc, devices->arm,
                                            devices->probe};
    return all[i];
}

/* Whether a camera of the geometry is a device of its own, and not a further stop of a camera
 * before it. */
static inline gboolean devices_is_unit(const struct rig *rig, int camera) {
    return rig->cameras[camera].stop == 0;
}

/* Opens everything, or nothing. Moves nothing; lamps and lasers are off afterwards. Every error
 * names file, line and key. */
struct devices *devices_open(const char *rig_path, GError **error);

/* The geometry alone, checked in the same way, without opening a device. */
gboolean devices_read_geometry(const char *rig_path, struct rig *ret, GError **error);
/* Geometry and timing from the rig file's options alone, for a plan without the hardware: nothing
 * real is opened. Values that only an open device can tell are assumed; a line about each is added
 * to assumed (char *, with a free function). */
gboolean devices_read_timing(const char *rig_path, struct rig *ret_geometry,
                             struct rig_timing *ret_timing, GPtrArray *assumed, GError **error);
/* Reads the geometry from the text of a rig file that a session keeps; path is used in errors. */
gboolean devices_parse_geometry(const char *text, const char *path, struct rig *ret,
                                GError **error);

/* Every device is simulated, whatever clock it has. */
gboolean devices_are_simulated(const struct devices *devices);

/* Switches lamps and lasers off, stops the axes and closes all devices. NULL is ignored. */
void devices_close(struct devices *devices);

/* Commands the safe state now: all lamps and lasers off, all axes stopped. Errors are collected
 * into the first one; every device is tried. */
gboolean devices_make_safe(struct devices *devices, GError **error);

/* The result of that command: class, name and "read back", "commanded only" (no answer yet) or "NOT
 * safe" of each laser, lamp bank and axis, as a(sss), floating. ret: DEVICE_TOLD if one has not
 * answered, else DEVICE_UNSAFE if one is, else DEVICE_SAFE. */
GVariant *devices_safety(const struct devices *devices, enum device_safety *ret);

/* The permit and the function of each axis, bank and laser (drivers/device.h), each device once. */
void devices_set_permit(struct devices *devices, DevicePermit permit, gpointer data);
void devices_watch_safety(struct devices *devices, DeviceSafetyFunc func, gpointer data);
/* What each device, interlocks and cameras included, reports of itself: “camera cam30: MODEL,
 * serial number 7” (char *, with a free function), by class and name. A device that reports nothing
 * is not in it. All devices must be open. */
GPtrArray *devices_identities(const struct devices *devices);
/* Whether one of them should be off or stand and has not confirmed it. */
gboolean devices_any_unsafe(const struct devices *devices);

/* Commands the safe state, and waits until every device has confirmed it: lasers and lamps that
 * they are off, axes that they stand, also axes that another program has started. FALSE: at least
 * one has not confirmed. Runs the main loop, and removes all other listeners from the devices. */
gboolean devices_secure(struct devices *devices, GError **error);

/* Begins a reason or an event that reports that lamps, lasers or axes may not be safe. */
#define DEVICES_UNSAFE "THE RIG COULD NOT BE MADE SAFE"

/* Describes the driver, or the section of the rig file, of this name, with its options, for
 * `mesorig drivers`; NULL: there is none of that name. name NULL: one line for each of them; as
 * JSON with all options. g_free(). */
char *devices_describe_drivers(const char *name, gboolean json);

/* The i-th of all drivers, by class; NULL: there are no more. */
const struct driver_info *devices_driver(gsize i);

/* The keys of [rig], [lamp NAME] and [mark NAME], and those that sections of cameras and lasers
 * have beside their drivers'; NULL: the class has none. */
const struct option *devices_section_options(const char *class_name);
