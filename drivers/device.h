/*
 * Shared by all device classes: the declaration of a driver, the opening of a device from a section
 * of the rig file, and the errors that a device can have.
 *
 * A device belongs to the main loop's thread. Calls return immediately. Every operation that takes
 * time ends in exactly one event. The event is called back from the main loop, never from within
 * the call that requested the operation. A driver whose library blocks calls it in a separate
 * thread, which only posts to the main context. Calls take effect in the order in which they were
 * made. The class keeps the deadlines, not the driver: if a driver does not report in time, the
 * class reports DEVICE_ERROR_TIMEOUT.
 */
#pragma once

#include "base/error_details.h"
#include "base/options.h"
#include "clock.h"

#define DEVICE_ERROR device_error_quark()
GQuark device_error_quark(void); /* its errors carry details: base/error_details.h */

enum device_error {
    DEVICE_ERROR_RANGE,        /* the request cannot be carried out as given; nothing moved */
    DEVICE_ERROR_BUSY,         /* the device does something else, or another program uses it */
    DEVICE_ERROR_TIMEOUT,      /* the device did not answer before its deadline */
    DEVICE_ERROR_DISCONNECTED, /* the device is not connected, or was reset */
    DEVICE_ERROR_STALLED,      /* an axis did not reach its target, or left it */
    DEVICE_ERROR_INTERLOCK,    /* the interlock forbids light or motion */
    DEVICE_ERROR_PROTOCOL,     /* the answer of the device is invalid, or reports a failure */
    /* A frame that was not exposed after its trigger, or that was seen before. */
    DEVICE_ERROR_STALE,
    DEVICE_ERROR_UNSUPPORTED, /* the device cannot do that */
};

/* Makes an error of a device. `who` names the device (struct device has the name). A lower layer
 * that does not know the name passes NULL, and its caller adds the name with
 * error_details_add_subject(). The format says what happened, without the name of the device, and
 * then what to do, after ERROR_ADVICE. For example,
 *     device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
 *                      "its position is not known" ERROR_ADVICE "home it first");
 * reads "axis turntable: its position is not known; home it first". device_error_set() always
 * returns FALSE, so that a caller can return its value. */
GError *device_error_new(enum device_error code, const char *who, const char *format, ...)
    G_GNUC_PRINTF(3, 4);
gboolean device_error_set(GError **error, enum device_error code, const char *who,
                          const char *format, ...) G_GNUC_PRINTF(4, 5);

/* First member of every class's driver struct. */
struct driver_info {
    const char *class_name; /* "axis", "lamps", "camera", "laser", "interlock" */
    const char *name;       /* the value of the key "driver", for example "sim-axis" */
    const char *help;       /* one sentence */
    /* The options that fill the private struct; the table ends with a NULL name. */
    const struct option *options;
    /* size of the private struct; the class allocates it zeroed, fills it from the options, and
     * frees it */
    gsize priv_size;
    /* May be NULL. Adds mistakes that can be found without the device: options of a section that
     * contradict each other, and faults of other files that the section names. All sections of the
     * rig file are checked before any device is opened, so a driver's open() need not repeat these
     * checks. */
    void (*check)(gconstpointer options, const struct config_section *section, Mistakes *mistakes);
    /* May be NULL. Appends the names of the things that the section needs for its exclusive use,
     * such as "coil 3 of unit 1 at tcp:10.0.0.2:502", as strings allocated with g_strdup(). Two
     * sections that need the same thing must give it the same name. They are a mistake in the rig
     * file. */
    void (*needs)(gconstpointer options, GPtrArray *to);
    /* What a confirmed command means for a device that cannot report its outputs, such as "sent,
     * cannot be read back". NULL means that the outputs were read back. */
    const char *confirmed;
};

/* The state of a device after the command to switch off or to stop, as far as it is known. */
enum device_safety {
    /* The device has confirmed the last command. If driver_info.confirmed is NULL, the driver has
     * read the state back. */
    DEVICE_SAFE,
    /* The device refused the command, did not answer in time, or reports another state. The class
     * sends the command again until the device has confirmed it. */
    DEVICE_UNSAFE,
    DEVICE_TOLD, /* the device has not answered yet */
};

/* Whether there is light, as far as this is known. */
enum light {
    LIGHT_OFF, /* the last "off" was confirmed, and no "on" was sent since */
    LIGHT_ON,  /* light is wanted, or an "off" was sent and is not answered yet */
    /* The light should be off, a command has failed, and no "off" was confirmed since. */
    LIGHT_UNSAFE,
};

struct device;

/* Called before a device gives light or moves (on, home, move, turn), never before "off" or "stop".
 * If it returns FALSE with an error, nothing is sent to the device. Called in the main loop's
 * thread, from within the call that requests light or motion. */
typedef gboolean (*DevicePermit)(const struct device *device, gpointer data, GError **error);

/* Called from the main loop when a device becomes unsafe. A device is unsafe if an output that
 * should be off has not confirmed that it is off, or if an axis that should stand has not confirmed
 * that it stands. error says which output and why, and is valid during the call. When every output
 * of the device has confirmed its state, the function is called with error NULL. */
typedef void (*DeviceSafetyFunc)(struct device *device, const GError *error, gpointer data);

/* First member of every class's device struct. */
struct device {
    const struct driver_info *info;
    char *name; /* name from the section: "turntable" for "[axis turntable]" */
    Clock *clock;
    gpointer priv; /* state of the driver, of info->priv_size bytes */
    /* Set only during the driver's open(), for errors that name file and line of the section. */
    const struct config_section *section;
    char *who;      /* class and name, the subject of its errors: "axis turntable" */
    char *identity; /* see device_set_identity(); NULL if it is not known */

    /* Used only by device.c. */
    DevicePermit permit;
    DeviceSafetyFunc watch;
    gpointer permit_data, watch_data;
    GError *unsafe; /* the reason, if the device is unsafe; NULL if it is safe */
    gboolean told_unsafe;
    guint tell;
};

/* Sets the function that permits light and motion. With NULL, which is the initial state, light
 * and motion are always allowed. */
void device_set_permit(struct device *device, DevicePermit permit, gpointer data);

/* Sets the one function that is told when the device becomes unsafe or safe. This function stays
 * set when the listener of the class changes. If the device is already unsafe, the main loop soon
 * calls the function. func NULL removes it. */
void device_watch_safety(struct device *device, DeviceSafetyFunc func, gpointer data);
gboolean device_is_unsafe(const struct device *device);

/* For classes: fills a device from its section and checks the driver's options. `also` is an array
 * of further keys that the section may have, because the class or the rig reads them. The array
 * ends with NULL and need not contain "driver"; it may be NULL. device_clear() frees what this
 * function has allocated. */
gboolean device_init(struct device *device, const struct driver_info *info,
                     const struct config_section *section, const char *const *also, Clock *clock,
                     GError **error);
void device_clear(struct device *device);

/* For drivers, after they have connected: sets the identity of the device, with the model and the
 * serial number that the device reports. Each of these may be NULL or empty. address says where the
 * device is plugged in; it is used only if there is no serial number. The identities are kept with
 * a session, and a change is reported when the session is resumed. */
void device_set_identity(struct device *device, const char *model, const char *serial,
                         const char *address);

/* For the open() of a driver that works only in real time: fails if the rig's clock is virtual. */
gboolean device_check_real_clock(const struct device *device, GError **error);

/* For classes: records the result of the driver's open() (recording.h), and returns it. */
gboolean device_record_opened(const struct device *device, gboolean opened, GError **error);

/* For classes: returns whether the device may give light or move now. */
gboolean device_ask_permit(const struct device *device, GError **error);

/* For classes: sets whether the device is unsafe. `unsafe` says why the device is unsafe, or is
 * NULL if the device is safe. Only changes are reported to the function of device_watch_safety().
 * That function is called from the main loop, not from within this call. */
void device_report_safety(struct device *device, const GError *unsafe);
