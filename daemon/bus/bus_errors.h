/* Names of errors on the bus. */
#pragma once

#include <glib.h>

#define BUS_ERROR bus_error_quark()
GQuark bus_error_quark(void);
enum bus_error {
    BUS_ERROR_BUSY,       /* something else is under way; says what to do first */
    BUS_ERROR_NO_RIG,     /* no rig is open */
    BUS_ERROR_NO_SESSION, /* nothing is being captured */
    BUS_ERROR_BAD_PATH,   /* not an absolute path */
    BUS_ERROR_UNKNOWN,    /* no camera or option of that name */
    BUS_ERROR_NO_PICTURE, /* the camera has not taken one yet */
    BUS_ERROR_FAILED,     /* anything whose own domain has no name on the bus */
    BUS_ERROR_LIMIT,      /* a limit of time, memory or waiting calls was met; says which */
    BUS_ERROR_CANCELLED,  /* another call ended what this one had begun */
    BUS_ERROR_LATCHED,    /* SafeState was called, and Release was not */
    BUS_ERROR_DENIED,     /* polkit or the rights of a file do not allow it to the caller */
};

/* Registers the names of all error domains that cross the bus, so that a GError goes through as
 * org.mesorig.Error.SessionLocked and comes out with its domain and code. Daemon and client call
 * it once; further calls have no effect. */
void bus_errors_register(void);

/* Returns an error that D-Bus can carry: the given one if its domain has names, else
 * BUS_ERROR_FAILED with the same message. Takes ownership of the given error; the caller owns the
 * returned one. */
GError *bus_errors_wrap(GError *error);
