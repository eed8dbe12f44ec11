/* The options of Validate, Start, Resume and QueueAdd, as a client has sent them. Any thread. */
#pragma once

#include <glib.h>

struct bus_options {
    gboolean process, yes;
    char *calibration;                     /* path; NULL: what the rig file names */
    char *session_text, *calibration_text; /* of those files; NULL: they are to be read */
    char *exposures;                       /* session_conf_choose(); NULL: nothing is auto */
};

/* options: a{sv}; ret is zeroed before, and cleared by the caller in any case. BUS_ERROR_UNKNOWN:
 * an option does not exist, or has the wrong type. */
gboolean bus_options_read(GVariant *options, struct bus_options *ret, GError **error);
void bus_options_clear(struct bus_options *options);
typedef struct bus_options BusOptions;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(BusOptions, bus_options_clear)
