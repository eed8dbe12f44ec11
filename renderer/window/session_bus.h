/* The session bus of the user's desktop. */
#pragma once

#include <glib.h>

/* Returns whether there is a session bus. If there is none, GDBus would start a bus without other
 * clients. */
gboolean session_bus_is_there(void);
