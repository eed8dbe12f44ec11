/* A daemon to talk to: one that is found, or one of our own. */
#pragma once

#include "rig1-bus.h"

typedef struct Link Link;

/* Finds the daemon that the user means: the one that --address or --bus name, which must capture
 * into directory if that is given; or else the one that captures into directory (may be NULL); or
 * else the one that MESORIG_ADDRESS names; or else the only daemon of this user, on the system bus
 * or on the session bus. If there are several, the error lists them. */
Link *link_find(const char *directory, GError **error);

/* The daemon that has this rig open, or that --address or --bus name. NULL without an error: none.
 * A daemon that ends with another program does not count. */
Link *link_find_rig(const char *rig_path, GError **error);

/* For a rig that no daemon has open: the daemon that --address, --bus or MESORIG_ADDRESS name, or
 * the only one that has no rig open. The error lists what there is. */
Link *link_find_free(const char *rig_path, GError **error);

/* Starts a mesorigd that ends with this process or at link_free(), and leaves everything safe. */
Link *link_start(GError **error);

/* Waits for a private daemon's end. NULL is ignored. */
void link_free(Link *link);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Link, link_free)

BusRig1 *link_rig(Link *link); /* owned by the link */

/* How commands name this daemon: "--address unix:path=…" or "--bus system"; owned by the link. */
const char *link_option(const Link *link);

/* Returns what is appended to a command that the user is to type next, so that it reaches this
 * daemon: a blank and link_option() if this program was given such an option, or else "";
 * g_free(). */
char *link_again(const Link *link);
gboolean link_is_private(const Link *link);

/* The daemon has gone: its connection was closed, or its name on the bus has no owner. */
gboolean link_is_lost(const Link *link);

/* Adds the text of a file to the options for a daemon on a bus, which may run as another user and
 * then reads no file for us. Adds nothing for a private daemon, which reads the file itself. */
gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error);

/* Returns the stderr output of a private daemon, which explains why it has failed; g_free(). */
char *link_log(const Link *link);
