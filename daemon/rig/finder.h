/* What is on the buses of this machine, of all kinds that drivers are for. */
#pragma once

#include "drivers/found.h"

#include <glib.h>

/* A Modbus line to ask; the defaults of drivers for a NULL or 0. */
struct finder_modbus {
    const char *bus; /* "/dev/ttyUSB0" or "tcp:HOST:PORT"; NULL: none is asked */
    int baud;
    const char *parity; /* "none", "even", "odd" */
    int first, last;    /* units */
};

/* All there is, as struct found, to be freed with g_ptr_array_unref(). A bus that cannot be looked
 * at adds a sentence to ret_problems and does not keep the others from being. Takes a second or
 * two, and with Modbus a tenth of a second for each unit that is not there. NULL: bad arguments. */
GPtrArray *finder_scan(const struct finder_modbus *modbus, GPtrArray *ret_problems, GError **error);
