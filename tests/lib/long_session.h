/* The small rig's session with more views and lights, for tests that must come in between. */
#pragma once

#include <glib.h>

#define LONG_RINGS "30:16; 60:16"

/* Its path, in the folder; g_free(). rings: of views and lights. */
char *long_session_write(const char *folder, const char *rings);
