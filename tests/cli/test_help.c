/* --help of every command fits into a terminal of 80 columns. */
#include "cli/commands.h"
#include "lib/process.h"
#include "lib/test.h"

static void check(const char *command) {
    g_autofree char *text = process_mesorig(0, "%s--help", command);
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (char **line = lines; *line; line++)
        if (g_utf8_strlen(*line, -1) > 80)
            g_error("mesorig %s--help: longer than 80 columns: %s", command, *line);
}

static void check_all(const struct command *const *commands) {
    for (; *commands; commands++) {
        g_autofree char *name = g_strconcat((*commands)->name, " ", NULL);
        check(name);
        if ((*commands)->children)
            check_all((*commands)->children);
    }
}

TEST(width) {
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    check("");
    check_all(cli_commands());
}
