/* Names of errors on D-Bus. */
#pragma once

#include <glib.h>

#define BUS_ERROR bus_error_quark()
GQuark bus_error_quark(void);
enum bus_error {
    BUS_ERROR_BUSY, /* Another operation is under way, or a device has not confirmed that it is off
                       or stands still. The message says what to do first. */
    BUS_ERROR_NO_RIG,     /* no rig is open */
    BUS_ERROR_NO_SESSION, /* nothing is being captured */
    BUS_ERROR_BAD_PATH,   /* a path is not absolute */
    /* There is no device or option of that name, an option has the wrong type, or another
     * calibration is given for a session that is resumed. */
    BUS_ERROR_UNKNOWN,
    BUS_ERROR_NO_PICTURE, /* the camera has not taken a picture yet */
    /* any other error; also an error of a domain that has no names on the bus */
    BUS_ERROR_FAILED,
    /* A limit of time, memory or waiting calls was reached; the message says which. */
    BUS_ERROR_LIMIT,
    /* another call or an event has ended the operation; the message says which */
    BUS_ERROR_CANCELLED,
    /* the safe state is latched: SafeState was called, and Release has not been called since */
    BUS_ERROR_LATCHED,
    /* the caller has no right to make this call, or polkit has given no answer */
    BUS_ERROR_DENIED,
};

/* Registers the names of all error domains that are sent over the bus. A GError is then sent with a
 * name such as org.mesorig.Error.SessionLocked, and arrives with its domain and code. Daemon and
 * client call the function once. Further calls have no effect. */
void bus_errors_register(void);

/* Returns an error that can be sent over the bus. If the domain of `error` has names on the bus,
 * `error` itself is returned, otherwise a BUS_ERROR_FAILED with the same message. Takes ownership
 * of `error`. The caller owns the result. */
GError *bus_errors_wrap(GError *error);
