/* Shared by link.c (the connection to a daemon) and link_find.c (the choice of the daemon). */
#pragma once

#include "link.h"

struct Link {
    GDBusConnection *connection;
    BusRig1 *rig;
    GSubprocess *daemon; /* private: ours */
    char *folder;        /* of its socket and log */
    char *option;     /* with which commands name it: "--address unix:path=…", "--bus system" */
    gboolean passing; /* it ends with the program that has started it */
};

/* Connects to this daemon; an error if it does not answer, or this user may not call it. bus:
 * "system" or "session". */
Link *link_to(const char *address, GError **error);
Link *link_on_bus(const char *bus, GError **error);
