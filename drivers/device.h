/*
 * What all device classes share: how a driver is declared, how a device is opened from a section of
 * the rig file, and the errors a device can have.
 *
 * A device belongs to the main loop's thread. Calls return at once; what takes time ends in exactly
 * one event, called back from the main loop, never from within the call that asked for it. A driver
 * whose library blocks keeps it in a thread of its own that only posts to the main context. Calls
 * take effect in the order in which they were made. Deadlines are kept by the class, not by the
 * driver: a driver that says nothing is a fault with DEVICE_ERROR_TIMEOUT.
 */
#pragma once

#include "base/options.h"
#include "clock.h"

#define DEVICE_ERROR device_error_quark()
GQuark device_error_quark(void);

enum device_error {
    DEVICE_ERROR_RANGE,   /* the value asked for is outside the device's limits; nothing moved */
    DEVICE_ERROR_BUSY,    /* it is still doing something else */
    DEVICE_ERROR_TIMEOUT, /* it did not answer before its deadline */
    DEVICE_ERROR_DISCONNECTED, /* it is gone */
    DEVICE_ERROR_STALLED,      /* an axis did not get where it was sent */
    DEVICE_ERROR_INTERLOCK,    /* the interlock forbids it */
    DEVICE_ERROR_PROTOCOL,     /* it answered nonsense */
    DEVICE_ERROR_STALE,        /* a frame that was not exposed after its trigger, or seen before */
    DEVICE_ERROR_UNSUPPORTED,  /* it cannot do that */
};

/* First member of every class's driver struct. */
struct driver_info {
    const char *class_name;       /* "axis", "lamps", "camera", "laser", "interlock" */
    const char *name;             /* "sim-axis": the value of the driver key */
    const char *help;             /* one sentence */
    const struct option *options; /* of the priv struct; ends with a NULL name */
    gsize priv_size; /* allocated zeroed, filled from the options, freed by the class */
};

/* First member of every class's device struct. */
struct device {
    const struct driver_info *info;
    char *name; /* from the section: "[axis turntable]" is "turntable" */
    Clock *clock;
    gpointer priv; /* the driver's, of info->priv_size */
    /* During the driver's open() alone: for errors that name file and line. */
    const struct config_section *section;
};

/* For classes: fills a device from its section, checking the driver's options; also lists keys that
 * the class or the rig reads ("driver" always is). Undone by device_clear(). */
gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error);
void device_clear(struct device *device);
