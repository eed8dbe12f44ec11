/*
 * Shared by all device classes: how a driver is declared, how a device is opened from a section of
 * the rig file, and the errors that a device can have.
 *
 * A device belongs to the main loop's thread. Calls return at once; what takes time ends in exactly
 * one event, called back from the main loop, never from within the call that asked for it. A driver
 * whose library blocks keeps it in a thread of its own that only posts to the main context. Calls
 * take effect in the order in which they were made. The class keeps the deadlines, not the driver:
 * a driver that does not report in time is a fault with DEVICE_ERROR_TIMEOUT.
 */
#pragma once

#include "base/error_details.h"
#include "base/options.h"
#include "clock.h"

#define DEVICE_ERROR device_error_quark()
GQuark device_error_quark(void); /* its errors carry details: base/error_details.h */

enum device_error {
    DEVICE_ERROR_RANGE,   /* the requested value is outside the device's limits; nothing moved */
    DEVICE_ERROR_BUSY,    /* it is still doing something else */
    DEVICE_ERROR_TIMEOUT, /* it did not answer before its deadline */
    DEVICE_ERROR_DISCONNECTED, /* it is gone */
    DEVICE_ERROR_STALLED,      /* an axis did not reach its target */
    DEVICE_ERROR_INTERLOCK,    /* the interlock forbids it */
    DEVICE_ERROR_PROTOCOL,     /* its answer is invalid, or it reports a failure */
    DEVICE_ERROR_STALE,        /* a frame that was not exposed after its trigger, or seen before */
    DEVICE_ERROR_UNSUPPORTED,  /* it cannot do that */
};

/* An error of a device. who: the device it is about (struct device has it), or NULL in a lower
 * layer that does not know it: the caller adds it with error_details_add_subject(). The format says
 * what happened, without the device, and after ERROR_ADVICE what to do:
 *     device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
 *                      "its position is not known" ERROR_ADVICE "home it first");
 * reads "axis turntable: its position is not known; home it first". device_error_set() returns
 * FALSE always, for a caller that fails with it. */
GError *device_error_new(enum device_error code, const char *who, const char *format, ...)
    G_GNUC_PRINTF(3, 4);
gboolean device_error_set(GError **error, enum device_error code, const char *who,
                          const char *format, ...) G_GNUC_PRINTF(4, 5);

/* First member of every class's driver struct. */
struct driver_info {
    const char *class_name;       /* "axis", "lamps", "camera", "laser", "interlock" */
    const char *name;             /* "sim-axis": the value of the driver key */
    const char *help;             /* one sentence */
    const struct option *options; /* of the priv struct; ends with a NULL name */
    gsize priv_size; /* allocated zeroed, filled from the options, freed by the class */
    /* May be NULL. Adds mistakes that are known without the device: options of a section that do
     * not fit each other, and faults of other files that they name. All sections of the rig file
     * are checked before any device is opened; a driver's open() need not check them again. */
    void (*check)(gconstpointer options, const struct config_section *section, Mistakes *mistakes);
    /* May be NULL. Adds what the section needs for itself alone (char *, g_strdup()), in words that
     * are the same in every section that needs the same: "coil 3 of unit 1 at tcp:10.0.0.2:502".
     * Two sections that need the same are a mistake of the rig file. */
    void (*needs)(gconstpointer options, GPtrArray *to);
};

/* What is known about a device after the command to switch off or to stop. */
enum device_safety {
    DEVICE_SAFE,   /* it has confirmed the last command; drivers read the state back */
    DEVICE_UNSAFE, /* it refused, did not answer in time, or says otherwise; the class sends the
                      command again until the device has confirmed it */
    DEVICE_TOLD,   /* it has not answered yet */
};

/* Whether there is light, as far as it is known. */
enum light {
    LIGHT_OFF,    /* the last "off" was confirmed, and no "on" was sent since */
    LIGHT_ON,     /* it is wanted; or an "off" is on its way for the first time */
    LIGHT_UNSAFE, /* it should be off, a command has failed, and no "off" was confirmed since */
};

struct device;

/* Asked before a device gives light or moves (on, home, move, turn), never before "off" or "stop".
 * FALSE: refused, with an error; nothing is sent to the device. Called in the main loop's thread,
 * from within the call that asks for light or motion. */
typedef gboolean (*DevicePermit)(const struct device *device, gpointer data, GError **error);

/* Called from the main loop when a device becomes unsafe: an output that should be off, or an axis
 * that should stand, has not confirmed it (error says which and why, and is valid during the call);
 * and when everything of the device has confirmed again (error NULL). */
typedef void (*DeviceSafetyFunc)(struct device *device, const GError *error, gpointer data);

/* First member of every class's device struct. */
struct device {
    const struct driver_info *info;
    char *name; /* from the section: "[axis turntable]" is "turntable" */
    Clock *clock;
    gpointer priv; /* state of the driver, of info->priv_size bytes */
    /* Set only during the driver's open(), for errors that name file and line. */
    const struct config_section *section;
    char *who;      /* class and name, the subject of its errors: "axis turntable" */
    char *identity; /* see device_set_identity(); NULL: not known */

    /* Used by device.c alone. */
    DevicePermit permit;
    DeviceSafetyFunc watch;
    gpointer permit_data, watch_data;
    GError *unsafe; /* why it is not safe; NULL: it is */
    gboolean told_unsafe;
    guint tell;
};

/* permit NULL: always allowed, as it is at first. */
void device_set_permit(struct device *device, DevicePermit permit, gpointer data);

/* There is one such function for each device, which stays when the listener of the class changes.
 * It soon hears of a device that is unsafe already. func NULL: none. */
void device_watch_safety(struct device *device, DeviceSafetyFunc func, gpointer data);
gboolean device_is_unsafe(const struct device *device);

/* For classes: fills a device from its section, checking the driver's options; also lists keys that
 * the class or the rig reads ("driver" always is). Undone by device_clear(). */
gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error);
void device_clear(struct device *device);

/* For drivers, when they have connected: which device answers, as it reports itself. model and
 * serial may be NULL or empty; address, where it is plugged in, counts only without a serial
 * number. A resumed session is told when another device answers than before. */
void device_set_identity(struct device *device, const char *model, const char *serial,
                         const char *address);

/* For the open() of a driver that keeps real time: fails where the rig's clock is virtual. */
gboolean device_check_real_clock(const struct device *device, GError **error);

/* For classes: whether the device may give light or move now. */
gboolean device_ask_permit(const struct device *device, GError **error);

/* For classes: says that the device is unsafe, or with NULL that it is not. Only changes are
 * reported, from the main loop and not from within this call. */
void device_report_safety(struct device *device, const GError *unsafe);
