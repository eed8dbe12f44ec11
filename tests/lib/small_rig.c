#include "small_rig.h"
#include "lib/ok.h"

#include <string.h>

char *small_rig_changed(const char *text, const struct change *change) {
    GString *to = g_string_new(NULL);
    gboolean inside = FALSE;
    g_autofree char *key =
        change->line ? g_strndup(change->line, strcspn(change->line, " =")) : NULL;
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    g_assert_nonnull(strstr(text, change->head));
    for (char **line = lines; *line; line++) {
        g_autofree char *its = g_strndup(*line, strcspn(*line, " ="));
        if (**line == '[')
            inside = g_str_equal(*line, change->head);
        if (inside && (!key || g_str_equal(its, key)))
            continue;
        g_string_append_printf(to, "%s\n", *line);
        if (inside && **line == '[')
            g_string_append_printf(to, "%s\n", change->line);
    }
    return g_string_free(to, FALSE);
}

void small_rig_write(const char *directory, const char *name, const struct change *changes) {
    g_autofree char *from = g_strconcat(SOURCE_DIR "/tests/small/", name, NULL);
    g_autofree char *to = g_build_filename(directory, name, NULL);
    g_autofree char *text = NULL;
    ok(g_file_get_contents(from, &text, NULL, ERR));
    for (const struct change *change = changes; change && change->head; change++) {
        const gboolean fault = change->line && g_str_has_prefix(change->line, "fault_");
        if (!strstr(text, change->head) || (fault && !g_str_equal(name, "rig.conf")))
            continue;
        char *changed = small_rig_changed(text, change);
        g_free(text);
        text = changed;
    }
    ok(g_file_set_contents(to, text, -1, ERR));
}
