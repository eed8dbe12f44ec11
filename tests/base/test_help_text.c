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
        "     Show help options\n\nExamples:\n  mesorig compress weave.session -k 64   # a "
        "comment\n");
    g_assert_cmpstr(text, ==,
                    "Usage:\n  mesorig x [OPTION…] DIR\n\nHelp Options:\n  -h, --help            "
                    "Show help options\n\nExamples:\n  mesorig compress weave.session -k 64   # a "
                    "comment\n");
}

TEST(paragraphs) {
    g_autofree char *row = help_text_row("--method=a|b", "How:\va: one way\vb: the other way");
    g_assert_cmpstr(row, ==,
                    "  --method=a|b          How:\n                        a: one way\n"
                    "                        b: the other way\n");
}

/* A name with many choices and a long example are broken where a reader and a shell allow it. */
TEST(long_lines) {
    g_autofree char *row = help_text_row(
        "--method=first|second|third|fourth|fifth|sixth|seventh|eighth|ninth|tenth", "How");
    g_assert_true(g_str_has_prefix(
        row, "  --method=first|second|third|fourth|fifth|sixth|seventh|eighth|ninth|tenth\n"));
    g_autofree char *broken = help_text_row(
        "--method=first|second|third|fourth|fifth|sixth|seventh|eighth|ninth|tenth|the-eleventh",
        "How");
    g_assert_true(g_str_has_prefix(
        broken, "  --method=first|second|third|fourth|fifth|sixth|seventh|eighth|ninth|tenth|\n"
                "      the-eleventh      How\n"));
    g_autofree char *text = help_text_lay_out(
        "Examples:\n  mesorig calibrate lights poles.session -t poles.conf -c rig.calibration -o "
        "rig.calibration\n");
    g_assert_cmpstr(text, ==,
                    "Examples:\n  mesorig calibrate lights poles.session -t poles.conf -c "
                    "rig.calibration -o \\\n      rig.calibration\n");
}
