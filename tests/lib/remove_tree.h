/* Removes what a test or a benchmark has made, with all that is in it; links, not where they lead.
 */
#pragma once

#include <glib.h>

static inline void remove_tree(const char *path) {
    const char *const argv[] = {"/bin/rm", "-rf", path, NULL};
    g_autoptr(GError) error = NULL;
    g_spawn_sync(NULL, (char **)argv, NULL, G_SPAWN_DEFAULT, NULL, NULL, NULL, NULL, NULL, &error);
    g_assert_no_error(error);
}
