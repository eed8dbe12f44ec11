/* What link.c (a connection to one daemon) and link_find.c (which daemon that is) share. */
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

/* That daemon; an error if it does not answer or may not be asked. bus: "system" or "session". */
Link *link_to(const char *address, GError **error);
Link *link_on_bus(const char *bus, GError **error);
