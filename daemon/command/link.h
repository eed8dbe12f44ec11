/* A daemon to talk to: one that is found, or one of our own. */
#pragma once

#include "rig1-bus.h"

typedef struct Link Link;

/* directory may be NULL. In this order: the daemon that --address or --bus names; the daemon that
 * captures into directory; and without a directory, a private daemon of this user, the system bus,
 * the session bus. */
Link *link_find(const char *directory, GError **error);

/* Only those that have the rig open, or that --address or --bus name. NULL without an error: none.
 */
Link *link_find_rig(const char *rig_path, GError **error);

/* Starts a mesorigd that ends, leaving everything safe, with this process or link_free(). */
Link *link_start(GError **error);

/* Waits for a private daemon's end. NULL is ignored. */
void link_free(Link *link);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Link, link_free)

BusRig1 *link_rig(Link *link); /* owned by the link */
gboolean link_is_private(const Link *link);

/* The daemon has gone: its connection was closed, or its name on the bus has no owner. */
gboolean link_is_lost(const Link *link);

/* A daemon on a bus may be another user, who reads no file for us: adds the text of the file. Of a
 * private daemon, which reads the file itself, nothing is added. */
gboolean link_add_text(Link *link, GVariantDict *options, const char *key, const char *path,
                       GError **error);

/* Returns the stderr output of a private daemon, which explains why it has failed; g_free(). */
char *link_log(const Link *link);
