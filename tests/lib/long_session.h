/* The small rig's session with more views and lights, for tests that must come in between. */
#pragma once

#include <glib.h>

char *long_session_write(const char *folder);
