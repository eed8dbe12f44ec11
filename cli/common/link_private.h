/* Shared by link.c (the connection to a daemon) and link_find.c (the choice of the daemon). */
#pragma once

#include "link.h"

struct Link {
    GDBusConnection *connection;
    BusRig1 *rig;
    GSubprocess *daemon; /* the process of a private daemon; NULL for other daemons */
    char *folder;        /* folder of the socket and the log of the private daemon */
    /* the option with which commands name the daemon: "--address unix:path=…", "--bus system" */
    char *option;
    gboolean passing; /* the daemon ends with the program that has started it */
};

/* Both connect to the daemon at an address or on a bus. They return NULL with an error if the
 * daemon does not answer, or if this user may not call it. bus is "system" or "session". */
Link *link_to(const char *address, GError **error);
Link *link_on_bus(const char *bus, GError **error);
