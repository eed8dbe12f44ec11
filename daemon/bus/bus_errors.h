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
    /* No device or option has that name, an option has the wrong type, or a resumed session is
     * given another calibration. */
    BUS_ERROR_UNKNOWN,
    BUS_ERROR_NO_PICTURE, /* the camera has not taken a picture yet */
    BUS_ERROR_FAILED,     /* any other error, and errors of a domain without a name on the bus */
    /* A limit of time, memory or waiting calls was reached; the message says which. */
    BUS_ERROR_LIMIT,
    BUS_ERROR_CANCELLED, /* another call or event has ended the operation; the message says which */
    BUS_ERROR_LATCHED,   /* SafeState was called, and Release was not called since */
    /* the caller has no right to make this call, or polkit has given no answer */
    BUS_ERROR_DENIED,
};

/* Registers the names of all error domains that cross the bus. A GError is then transferred with a
 * name such as org.mesorig.Error.SessionLocked, and arrives with its domain and code. Daemon and
 * client call it once. Further calls have no effect. */
void bus_errors_register(void);

/* Returns an error that D-Bus can carry: the given error if its domain has names, otherwise
 * BUS_ERROR_FAILED with the same message. Takes ownership of the given error. The caller owns the
 * returned error. */
GError *bus_errors_wrap(GError *error);
