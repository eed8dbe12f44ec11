/* Laser units that are mounted by hand: the place of each unit according to the session, and the
 * shots that can be taken with the unit at that place. */
#pragma once

#include "capture_private.h"

/* Reads the last places of the units and passes them to the drivers. */
gboolean capture_mount_load(Capture *capture, GError **error);

/* Returns whether a shot can be taken with the laser units at their present places. */
gboolean capture_mount_is_in_place(const Capture *capture, const struct session_shot *shot);

/* Returns the number of remaining shots, in order, that can be taken before a unit must be mounted
 * at another place. Returns 0 if they need a unit whose place is not known. Sweeps from the present
 * places are moved to the front, because sweeps that are repeated may have been planned before
 * them. */
guint capture_mount_reach(Capture *capture);

/* Pauses with a prompt for the mounting that the next remaining shot needs. The rig is already safe
 * when this is called. */
void capture_mount_ask(Capture *capture);

/* Confirms that the requested mounting has been done, and stores it before the next shot. */
gboolean capture_mount_answer(Capture *capture, GError **error);
