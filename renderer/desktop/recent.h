/*
 * The materials and shapes that were opened last, in the list of the desktop
 * ($XDG_DATA_HOME/recently-used.xbel), which other programs share. Blocks while it reads or writes
 * that file. A file that is damaged is left as it is.
 */
#pragma once

#include <glib.h>

#define RECENT_MOST 9

/* Paths that this program has opened and that are still there, the latest first, RECENT_MOST at
 * most; g_ptr_array_unref(). */
GPtrArray *recent_list(void);

/* Puts a file or folder at the front of the list. Errors are ignored: the list is a convenience. */
void recent_add(const char *path);
