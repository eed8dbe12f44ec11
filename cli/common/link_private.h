/* Shared by link.c (the connection to a daemon) and link_find.c (the choice of the daemon). */
#pragma once

#include "link.h"

struct Link {
    GDBusConnection *connection;
    BusRig1 *rig;
    GSubprocess *daemon; /* the process of a private daemon; NULL for other daemons */
    char *folder;        /* folder of the socket and the log of the private daemon */
    /* the option with which a command names the daemon, such as "--address unix:path=…" or "--bus
     * system" */
    char *option;
    gboolean passing; /* the daemon is private to another program, and ends with that program */
};

/* Connect to the daemon at an address, or on the bus "system" or "session". They return NULL with
 * an error if the daemon does not answer, or if this user may not call it. */
Link *link_to(const char *address, GError **error);
Link *link_on_bus(const char *bus, GError **error);
