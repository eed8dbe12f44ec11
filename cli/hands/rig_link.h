/* Finds the daemon that runs a rig, and makes it open the rig. */
#pragma once

#include "common/link.h"

/* Finds a daemon that has the rig open or can open it. For a simulated rig that no daemon has open,
 * starts a private daemon unless --address or --bus names one. *ret_simulated says whether every
 * driver of the rig file is simulated. Mistakes in the rig file are reported before anything
 * else. */
Link *rig_link_find(const char *rig, gboolean *ret_simulated, GError **error);

/* Makes the daemon open this rig, unless it is open already. Fails with G_IO_ERROR_BUSY if the
 * daemon has another rig open. */
gboolean rig_link_open(Link *link, const char *rig, GError **error);
