/*
 * The materials and shapes that were opened last. They are kept in the desktop's list
 * ($XDG_DATA_HOME/recently-used.xbel), which all programs share. The functions block while they
 * read or write the file of this list. A damaged file is not changed.
 */
#pragma once

#include <glib.h>

#define RECENT_MAX 9

/* Returns at most RECENT_MAX paths that this program has opened and that still exist, the latest
 * first. Free the array with g_ptr_array_unref(). */
GPtrArray *recent_list(void);

/* Puts a file or folder at the front of the list. Errors are ignored, because the list is only a
 * convenience. */
void recent_add(const char *path);
