#include "long_session.h"

char *long_session_write(const char *folder, const char *rings) {
    char *path = g_build_filename(folder, "long.conf", NULL);
    g_autofree char *text = NULL;
    g_autoptr(GError) error = NULL;
    g_file_get_contents(SOURCE_DIR "/tests/small/session.conf", &text, NULL, &error);
    g_assert_no_error(error);
    g_auto(GStrv) parts = g_strsplit(text, "30:2; 60:2", -1);
    g_assert_cmpuint(g_strv_length(parts), ==, 3); /* views and lights */
    g_autofree char *longer = g_strjoinv(rings, parts);
    g_file_set_contents(path, longer, -1, &error);
    g_assert_no_error(error);
    return path;
}
