/* docs/develop/driver.md shows the shortest driver. Each piece of code in the guide, except the one
 * for a test, must be in that driver's file word for word, and the file must be as long as the
 * guide says. */
#include "lib/ok.h"
#include "lib/test.h"

#include <glib.h>
#include <string.h>

static char *load(const char *path) {
    char *text;
    ok(g_file_get_contents(path, &text, NULL, ERR));
    return text;
}

static int count_lines(const char *text) {
    int n = 0;
    for (; *text; text++)
        n += *text == '\n';
    return n;
}

TEST(pieces) {
    g_autofree char *guide = load(SOURCE_DIR "/docs/develop/driver.md");
    g_autofree char *source = load(SOURCE_DIR "/drivers/modbus/inputs.c");
    g_auto(GStrv) parts = g_strsplit(guide, "```", -1);
    int n = 0;
    for (int i = 1; parts[i] && parts[i + 1]; i += 2) {
        if (!g_str_has_prefix(parts[i], "c\n"))
            continue; /* a rig file */
        const char *piece = parts[i] + 2;
        if (strstr(piece, "struct conformance"))
            continue;
        if (!strstr(source, piece))
            g_error("docs/develop/driver.md shows what is not in drivers/modbus/inputs.c:\n%s",
                    piece);
        n++;
    }
    g_assert_cmpint(n, ==, 5);
}

TEST(length) {
    g_autofree char *guide = load(SOURCE_DIR "/docs/develop/driver.md");
    g_autofree char *source = load(SOURCE_DIR "/drivers/modbus/inputs.c");
    g_autofree char *says = g_strdup_printf("in %d lines", count_lines(source));
    g_assert_nonnull(strstr(guide, says));
}
