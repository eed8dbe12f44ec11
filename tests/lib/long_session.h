/* The session of the small rig with more views and lights, for tests that must interrupt a
 * capture. */
#pragma once

#include <glib.h>

#define LONG_RINGS "30:16; 60:16"

/* Writes its configuration into the folder and returns the path; g_free(). rings is the value for
 * both views and lights. */
char *long_session_write(const char *folder, const char *rings);
