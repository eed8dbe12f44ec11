/* Values of settings as libgphoto2 writes them. */
#include "gphoto2/setting_text.h"
#include "lib/test.h"

TEST(numbers) {
    static const struct {
        const char *text;
        double number;
    } cases[] = {
        {"1/200", 0.005}, {"0.0050s", 0.005}, {"30", 30},
        {"13/10", 1.3},   {"1.3 s", 1.3},     {"1/8000s", 1.25e-4},
        {"f/5.6", 5.6},   {"F/8", 8},         {"8", 8},
        {"ISO 400", 400}, {"iso400", 400},    {"80%", 80},
        {"4 ms", 0.004},  {"10\"", 10},       {".5", 0.5},
        {"bulb", -1},     {"Auto", -1},       {"", -1},
        {"1/0", -1},      {"-1", -1},         {"100 (auto)", -1},
        {"1/", -1},       {"inf", -1},        {"Auto ISO", -1},
        {"1/200/3", -1},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        if (!(ABS(setting_text_number(cases[i].text) - cases[i].number) < 1e-9))
            g_error("“%s” is %g, not %g", cases[i].text, setting_text_number(cases[i].text),
                    cases[i].number);
}

TEST(equal) {
    g_assert_true(setting_text_equal("1/200", "0.0050s"));
    g_assert_true(setting_text_equal("f/8", "8"));
    g_assert_true(setting_text_equal("Manual", "manual"));
    g_assert_false(setting_text_equal("1/200", "1/250"));
    g_assert_false(setting_text_equal("1/8000", "1/6400"));
    g_assert_false(setting_text_equal("bulb", "Time"));
    g_assert_false(setting_text_equal("8", "bulb"));
}

TEST(nearest) {
    static const char *const times[] = {"bulb", "1", "1/10", "1/100", "1/1000", NULL};
    static const char *const words[] = {"RAW", "JPEG", NULL};
    g_assert_cmpint(setting_text_nearest("1/80", times), ==, 3);
    g_assert_cmpint(setting_text_nearest("1/20", times), ==, 2);
    g_assert_cmpint(setting_text_nearest("30", times), ==, 1);
    g_assert_cmpint(setting_text_nearest("slow", times), ==, -1);
    g_assert_cmpint(setting_text_nearest("1/80", words), ==, -1);
}
