/* Laser units that are mounted by hand: where the session says that each one is, and which shots
 * can be taken with it there. */
#pragma once

#include "capture_private.h"

/* Reads the last places of the units, and passes them to the drivers. */
gboolean capture_mount_load(Capture *capture, GError **error);

/* Whether a shot can be taken with the laser units where they are. */
gboolean capture_mount_is_in_place(const Capture *capture, const struct session_shot *shot);

/* The number of remaining shots that can be taken, in order, before a unit must be mounted
 * elsewhere; none if they need a unit whose place is not known. Sweeps from where the units are
 * come first: those that are taken again may have been planned before them. */
guint capture_mount_reach(Capture *capture);

/* Pauses with a prompt for the mounting that the next remaining shot needs. The rig is safe
 * already. */
void capture_mount_ask(Capture *capture);

/* The requested mounting has been done. Stores that before the next shot. */
gboolean capture_mount_answer(Capture *capture, GError **error);
