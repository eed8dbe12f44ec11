#include "base/help_text.h"
#include "lib/test.h"

#include <string.h>

TEST(row) {
    g_autofree char *brief = help_text_row("-k, --clusters=N", "Number of clusters");
    g_assert_cmpstr(brief, ==, "  -k, --clusters=N      Number of clusters\n");
    g_autofree char *longer = help_text_row("-o, --output=FILE.exr or a folder", "The file");
    g_assert_cmpstr(longer, ==,
                    "  -o, --output=FILE.exr or a folder\n                        The file\n");
    g_autofree char *exact = help_text_row("--twenty-characters_", "x");
    g_assert_cmpstr(exact, ==, "  --twenty-characters_  x\n");
}

/* 56 characters fit behind column 24; characters count, not bytes. */
TEST(wrapped) {
    g_autofree char *fits =
        help_text_row("--a", "äöü456789 123456789 123456789 123456789 123456789 "
                             "123456");
    g_assert_null(strchr(strchr(fits, '\n') + 1, '\n'));
    g_autofree char *breaks = help_text_row("--a", "äöü456789 123456789 123456789 123456789 "
                                                   "123456789 1234567");
    g_assert_cmpstr(strchr(breaks, '\n'), ==, "\n                        1234567\n");
}

TEST(lay_out) {
    g_autofree char *text = help_text_lay_out(
        "Usage:\n  mesorig x [OPTION…] DIR\n\nHelp Options:\n  -h, --help                        "
        "     Show help options\n\nExamples:\n  mesorig compress weave.session -m lpca -k 64 "
        "--components 12 --quantise packed   # a comment\n");
    g_assert_cmpstr(text, ==,
                    "Usage:\n  mesorig x [OPTION…] DIR\n\nHelp Options:\n  -h, --help            "
                    "Show help options\n\nExamples:\n  mesorig compress weave.session -m lpca -k "
                    "64 --components 12 --quantise packed   # a comment\n");
}
