/* The command lines of the programs, which base/program.c reads. */
#include "lib/process.h"
#include "lib/test.h"

#include <string.h>

static const char *const programs[] = {"mesorigd",      "mesorig-hooks", "mesorig-rig",
                                       "mesorig-trace", "mesorig-view",  "mesorig-web"};

static char *text_of(const char *program, int code, const char *argument) {
    g_autofree char *path = g_build_filename(BUILD_DIR, "bin", program, NULL);
    const char *const argv[] = {path, argument, NULL};
    return process_text(code, argv);
}

/* --help names the program and fits into a terminal of 80 columns. */
TEST(help) {
    for (gsize i = 0; i < G_N_ELEMENTS(programs); i++) {
        g_autofree char *text = text_of(programs[i], 0, "--help");
        g_autofree char *usage = g_strdup_printf("Usage:\n  %s [OPTION…]", programs[i]);
        g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
        assert_has(text, usage);
        assert_has(text, "--version");
        for (char **line = lines; *line; line++)
            if (g_utf8_strlen(*line, -1) > 80)
                g_error("%s --help: longer than 80 columns: %s", programs[i], *line);
    }
}

TEST(version) {
    for (gsize i = 0; i < G_N_ELEMENTS(programs); i++) {
        g_autofree char *text = text_of(programs[i], 0, "--version");
        g_autofree char *expected = g_strdup_printf("%s " MESORIG_VERSION "\n", programs[i]);
        g_assert_cmpstr(text, ==, expected);
    }
}

/* Bad usage ends with 2, and says how to call the program. */
TEST(bad_usage) {
    for (gsize i = 0; i < G_N_ELEMENTS(programs); i++) {
        g_autofree char *text = text_of(programs[i], 2, "--versoin");
        g_autofree char *begin =
            g_strdup_printf("%s: Unknown option --versoin; did you mean --version?\nUsage: %s",
                            programs[i], programs[i]);
        assert_has(text, begin);
        assert_has(text, " --help” lists the options.\n");
    }
    g_autofree char *extra = text_of("mesorig-web", 2, "x");
    assert_has(extra, "mesorig-web: there are too many arguments\n");
    g_autofree char *missing = text_of("mesorig-trace", 2, "--json");
    assert_has(missing, "mesorig-trace: an argument is missing\n");
}
