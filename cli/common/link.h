/* A connection to a daemon: one that is already running, or a private one of this process. */
#pragma once

#include "rig1-bus.h"

typedef struct Link Link;

/* Finds the daemon that the user means. This is the first of the following: the daemon of --address
 * or --bus, which must capture into directory if that is given; the daemon that captures into
 * directory (may be NULL); the daemon of MESORIG_ADDRESS; the only daemon of this user, on the
 * system bus or on the session bus. If there are several, the error lists them. If there is none,
 * the error says how to start one. */
Link *link_find(const char *directory, GError **error);

/* Finds the daemon that has this rig open, or the daemon of --address or --bus. Returns NULL
 * without an error if there is none, and NULL with an error if several daemons have the rig open,
 * or if the daemon of --address or --bus does not answer. A daemon that ends with another program
 * is ignored. */
Link *link_find_rig(const char *rig_path, GError **error);

/* Finds a daemon for a rig with real devices that no daemon has open: the daemon of --address,
 * --bus or MESORIG_ADDRESS, or the only daemon that has no rig open. The error lists the daemons
 * that were found. */
Link *link_find_free(const char *rig_path, GError **error);

/* Starts a private mesorigd. It ends with this process or at link_free(), and leaves the rig
 * safe. */
Link *link_start(GError **error);

/* Closes the connection, and waits until a private daemon has ended. NULL is ignored. */
void link_free(Link *link);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Link, link_free)

BusRig1 *link_rig(Link *link); /* owned by the link */

/* Returns the option with which commands name this daemon: "--address unix:path=…" or "--bus
 * system". Owned by the link. */
const char *link_option(const Link *link);

/* Returns the text to append to a command that the user is told to type, so that the command
 * reaches this daemon. The text is a blank and link_option() if this program was given such an
 * option, otherwise "". g_free() */
char *link_again(const Link *link);
gboolean link_is_private(const Link *link);

/* Returns whether the daemon has gone: its connection was closed, or its name on the bus has no
 * owner. */
gboolean link_is_lost(const Link *link);

/* Adds the text of a file to the options for a daemon on a bus. Such a daemon may run as another
 * user and does not read files for its callers. Adds nothing for a daemon that is not on a bus,
 * which reads the file itself. */
gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error);

/* Returns the stderr output of a private daemon, which explains why the daemon has failed;
 * g_free(). */
char *link_log(const Link *link);
