/* A daemon to talk to: one that is found, or one of our own. */
#pragma once

#include "rig1-bus.h"

typedef struct Link Link;

/* The daemon that is meant. By --address or --bus, which must capture into directory if that is
 * given; or else by directory (may be NULL), the daemon that captures into it; or else by
 * MESORIG_ADDRESS; or else the only daemon there is: of this user, on the system bus, on the
 * session bus. Several are an error, which lists them. */
Link *link_find(const char *directory, GError **error);

/* The daemon that has this rig open, or that --address or --bus name. NULL without an error: none.
 * A daemon that ends with another program does not count. */
Link *link_find_rig(const char *rig_path, GError **error);

/* For a rig that no daemon has open: the daemon that --address, --bus or MESORIG_ADDRESS name, or
 * the only one that has no rig open. The error lists what there is. */
Link *link_find_free(const char *rig_path, GError **error);

/* Starts a mesorigd that ends, leaving everything safe, with this process or link_free(). */
Link *link_start(GError **error);

/* Waits for a private daemon's end. NULL is ignored. */
void link_free(Link *link);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Link, link_free)

BusRig1 *link_rig(Link *link); /* owned by the link */

/* How commands name this daemon: "--address unix:path=…" or "--bus system"; owned by the link. */
const char *link_option(const Link *link);

/* What a command that is printed for the user to type next needs to reach this daemon:
 * link_option() after a blank if this program was told so, or else ""; g_free(). */
char *link_again(const Link *link);
gboolean link_is_private(const Link *link);

/* The daemon has gone: its connection was closed, or its name on the bus has no owner. */
gboolean link_is_lost(const Link *link);

/* A daemon on a bus may be another user, who reads no file for us: adds the text of the file. Of a
 * private daemon, which reads the file itself, nothing is added. */
gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error);

/* Returns the stderr output of a private daemon, which explains why it has failed; g_free(). */
char *link_log(const Link *link);
