/* Laser units that somebody mounts by hand: where each is, as the session knows it, and what can be
 * taken with them there. */
#pragma once

#include "capture_private.h"

/* Reads where the units were last, and tells their drivers. */
gboolean capture_mount_load(Capture *capture, GError **error);

/* How many of the remaining shots can be taken, in order, before a unit must be mounted elsewhere;
 * none if it is not known where one is that they need. Sweeps from where the units are come first:
 * those that are taken again may have been planned before them. */
guint capture_mount_reach(Capture *capture);

/* Pauses with a prompt for the mounting that the next remaining shot needs. The rig is safe
 * already. */
void capture_mount_ask(Capture *capture);

/* The requested mounting has been done. Stores that before the next shot. */
gboolean capture_mount_answer(Capture *capture, GError **error);
