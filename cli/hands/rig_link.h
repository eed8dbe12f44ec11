/* The daemon that runs a rig. */
#pragma once

#include "common/link.h"

/* Finds a daemon that has the rig open, or may open it; a simulated rig gets a private daemon.
 * ret_simulated: whether every driver of the rig file is. Mistakes in the file are reported before
 * all else. */
Link *rig_link_find(const char *rig, gboolean *ret_simulated, GError **error);

/* Sees to it that the daemon has this rig open, and no other. */
gboolean rig_link_open(Link *link, const char *rig, GError **error);
