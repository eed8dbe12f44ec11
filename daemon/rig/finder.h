/* Searches all buses of this machine for devices that have a driver. */
#pragma once

#include "drivers/found.h"

#include <glib.h>

/* A Modbus line to search; a member that is NULL or 0 has the drivers' default. */
struct finder_modbus {
    const char *bus; /* "/dev/ttyUSB0" or "tcp:HOST:PORT"; NULL: none is asked */
    int baud;
    const char *parity; /* "none", "even", "odd" */
    int first, last;    /* units */
};

/* All devices found, as struct found, to be freed with g_ptr_array_unref(). A bus that cannot be
 * searched adds a sentence to ret_problems; the others are searched all the same. Takes a second or
 * two, and with Modbus a tenth of a second for each absent unit. NULL: bad arguments. */
GPtrArray *finder_scan(const struct finder_modbus *modbus, GPtrArray *ret_problems, GError **error);
