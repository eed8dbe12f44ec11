/* Finds the daemon that runs a rig, and makes it open the rig. */
#pragma once

#include "common/link.h"

/* Finds a daemon that has the rig open or can open it. If the rig is simulated and no daemon has it
 * open, a private daemon is started, provided that neither --address nor --bus is given.
 * *ret_simulated says whether all drivers in the rig file are simulated. Mistakes in the rig file
 * are reported before anything else. */
Link *rig_link_find(const char *rig, gboolean *ret_simulated, GError **error);

/* Makes the daemon open this rig if it is not open. Fails with G_IO_ERROR_BUSY if the daemon has
 * another rig open. */
gboolean rig_link_open(Link *link, const char *rig, GError **error);
