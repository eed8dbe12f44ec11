/* The options of Validate, Start, Resume and QueueAdd, as a client has sent them. Any thread may
 * call these functions. */
#pragma once

#include <glib.h>

struct bus_options {
    gboolean process, yes;
    char *calibration; /* path of the calibration; NULL for the file that the rig file names */
    /* Contents of the session file and of the calibration; NULL if the daemon has to read the
     * files. */
    char *session_text, *calibration_text;
    /* Lines for session_conf_choose(); NULL if no exposure is "auto". */
    char *exposures;
};

/* Reads options of type a{sv}. The caller zeroes ret before the call, and clears it afterwards,
 * even after a failure. Returns FALSE with BUS_ERROR_UNKNOWN if an option does not exist or has the
 * wrong type. */
gboolean bus_options_read(GVariant *options, struct bus_options *ret, GError **error);
void bus_options_clear(struct bus_options *options);
typedef struct bus_options BusOptions;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(BusOptions, bus_options_clear)
