/* A connection to a daemon: one that is already running, or a private one of this process. */
#pragma once

#include "rig1-bus.h"

typedef struct Link Link;

/* Finds the daemon that the user means, which is the first of the following:
 * - the daemon of --address or --bus, which must capture into directory if directory is not NULL,
 * - the daemon that captures into directory,
 * - the daemon of MESORIG_ADDRESS,
 * - the only daemon that this user can reach: among the user's own daemons and those on the system
 *   bus and the session bus.
 *
 * If there are several in the last case, the error lists them. If there is none, the error says how
 * to start one. */
Link *link_find(const char *directory, GError **error);

/* Finds the daemon of --address or --bus. Without these options, finds the daemon that has this rig
 * open; private daemons of other programs are ignored. Returns NULL without an error if no daemon
 * has the rig open. Returns NULL with an error if several have, or if the daemon of --address or
 * --bus does not answer. */
Link *link_find_rig(const char *rig_path, GError **error);

/* Finds a daemon for a rig with real devices that no daemon has open. This is the daemon of
 * --address, --bus or MESORIG_ADDRESS, otherwise the only daemon that has no rig open. If there is
 * no such daemon, or if there are several, the error lists the daemons that were found. */
Link *link_find_free(const char *rig_path, GError **error);

/* Starts a private mesorigd. The daemon ends with this process or at link_free(), and makes the rig
 * safe before it ends. */
Link *link_start(GError **error);

/* Closes the connection, and waits until a private daemon has ended. NULL is ignored. */
void link_free(Link *link);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Link, link_free)

BusRig1 *link_rig(Link *link); /* owned by the link */

/* Returns the option with which a command names this daemon, such as "--address unix:path=…" or
 * "--bus system". The text is owned by the link. */
const char *link_option(const Link *link);

/* Returns the text to append to a command that the user is told to type, so that the command
 * reaches this daemon. If this program was given an option that names the daemon, the text is a
 * blank and link_option(), otherwise "". Free it with g_free(). */
char *link_again(const Link *link);
gboolean link_is_private(const Link *link);

/* Returns whether the daemon has gone. It has gone if its connection was closed, or if its name on
 * the bus has no owner. */
gboolean link_is_lost(const Link *link);

/* If the daemon is on a bus, adds the text of a file to the options, because such a daemon may run
 * as another user and does not read files for its callers. Otherwise adds nothing, because the
 * daemon reads the file itself. Returns FALSE with an error if the file cannot be read. */
gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error);

/* Returns the stderr output of a private daemon, which explains why the daemon has failed;
 * g_free(). */
char *link_log(const Link *link);
