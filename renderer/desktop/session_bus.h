/* The bus of the user's desktop. */
#pragma once

#include <glib.h>

/* Whether there is one. Where there is none, GDBus would start a bus that nobody else is on. */
gboolean session_bus_is_there(void);
