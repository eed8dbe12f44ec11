#include "long_session.h"
#include "lib/ok.h"

char *long_session_write(const char *folder, const char *rings) {
    char *path = g_build_filename(folder, "long.conf", NULL);
    g_autofree char *text = NULL;
    ok(g_file_get_contents(SOURCE_DIR "/tests/small/session.conf", &text, NULL, ERR));
    g_auto(GStrv) parts = g_strsplit(text, "30:2; 60:2", -1);
    g_assert_cmpuint(g_strv_length(parts), ==, 3); /* the sections of views and of lights */
    g_autofree char *longer = g_strjoinv(rings, parts);
    ok(g_file_set_contents(path, longer, -1, ERR));
    return path;
}
