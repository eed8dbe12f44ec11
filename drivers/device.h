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
};

/* What is known about a device after the command to switch off or to stop. */
enum device_safety {
    DEVICE_SAFE,   /* it has confirmed the last command; drivers read the state back */
    DEVICE_UNSAFE, /* it refused, did not answer in time, or says otherwise */
    DEVICE_TOLD,   /* it has not answered yet */
};

/* First member of every class's device struct. */
struct device {
    const struct driver_info *info;
    char *name; /* from the section: "[axis turntable]" is "turntable" */
    Clock *clock;
    gpointer priv; /* state of the driver, of info->priv_size bytes */
    /* Set only during the driver's open(), for errors that name file and line. */
    const struct config_section *section;
    char *who; /* class and name, the subject of its errors: "axis turntable" */
};

/* For classes: fills a device from its section, checking the driver's options; also lists keys that
 * the class or the rig reads ("driver" always is). Undone by device_clear(). */
gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error);
void device_clear(struct device *device);

/* For the open() of a driver that keeps real time: fails where the rig's clock is virtual. */
gboolean device_check_real_clock(const struct device *device, GError **error);
