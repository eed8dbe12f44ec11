/* The session bus of the user's desktop. */
#pragma once

#include <glib.h>

/* Returns whether there is a session bus. Without a session bus, GDBus would start a bus that has
 * no other clients. */
gboolean session_bus_is_there(void);
