#include "base/options.h"
#include "drivers/frame.h"
#include "lib/test.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <locale.h>
#include <string.h>

struct target {
    gboolean wraps;
    int count;
    double settle_ms, speed_deg_s;
    char *title, *world;
    int kind;
    struct option_doubles exposures_us;
    char **lamps;
};

#define FIELD(name) G_STRUCT_OFFSET(struct target, name)

static const char *const kinds[] = {"old", "relabelled", NULL};

static const struct option table[] = {
    {"wraps", OPTION_BOOL, NULL, 0, 0, "no", NULL, FIELD(wraps), "Turns without end"},
    {"count", OPTION_INT, NULL, 1, 20, "3", NULL, FIELD(count), "How many"},
    {"settle_ms", OPTION_DOUBLE, "ms", 0, 1000, "150", NULL, FIELD(settle_ms), "How long"},
    {"speed_deg_s", OPTION_DOUBLE, "deg/s", 0, 0, NULL, NULL, FIELD(speed_deg_s), "How fast"},
    {"title", OPTION_STRING, NULL, 0, 0, "a \"title\"", NULL, FIELD(title), "A name"},
    {"world", OPTION_PATH, NULL, 0, 0, "", NULL, FIELD(world), "A file"},
    {"kind", OPTION_CHOICE, NULL, 0, 0, "old", kinds, FIELD(kind), "Which"},
    {"exposures_us", OPTION_DOUBLES, "µs", 1, 1e6, "10;20", NULL, FIELD(exposures_us), "All"},
    {"lamps", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(lamps), "Names"},
    {NULL},
};

static const char *const also[] = {"driver", "theta_deg", NULL};

static const char *const good = "# A comment\n"
                                "[rig]\n"
                                "id = demo\n"
                                "\n"
                                "  [axis  turn table]  \n"
                                "driver=sim-axis\n"
                                "wraps = yes\n"
                                "count = 7\n"
                                "settle_ms = 12.5\n"
                                "speed_deg_s=-1e3\n"
                                "title = x = y # z \n"
                                "world = ../worlds/a.conf\n"
                                "kind = relabelled\n"
                                "exposures_us = 100; 2000.5 ;30000;\n"
                                "lamps = lamp15; lamp 30\n"
                                "theta_deg = 3\n"
                                "[axis arc]\n"
                                "speed_deg_s = 1";

TEST(sections) {
    GError *error = NULL;
    g_autoptr(Config) config = config_parse(good, "/etc/rigs/rig.conf", &error);
    g_assert_no_error(error);
    gsize n;
    const struct config_section *sections = config_sections(config, &n);
    g_assert_cmpuint(n, ==, 3);
    g_assert_cmpstr(sections[0].class_name, ==, "rig");
    g_assert_null(sections[0].name);
    g_assert_cmpstr(sections[1].class_name, ==, "axis");
    g_assert_cmpstr(sections[1].name, ==, "turn table");
    g_assert_cmpint(sections[1].line, ==, 5);
    g_assert_cmpstr(config_text(config), ==, good);
    g_assert_true(config_find(config, "axis", "turn table") == &sections[1]);
    g_assert_true(config_find(config, "rig", NULL) == &sections[0]);
    g_assert_null(config_find(config, "axis", NULL)); /* not the only one */
    g_assert_null(config_find(config, "axis", "sweep"));
    int line = 0;
    g_assert_cmpstr(config_value(&sections[1], "title", &line), ==, "x = y # z");
    g_assert_cmpint(line, ==, 11);
    g_assert_null(config_value(&sections[1], "id", NULL));
    g_assert_cmpstr(config_keys(&sections[2])[0], ==, "speed_deg_s");
    g_assert_null(config_keys(&sections[2])[1]);
    g_autofree char *path = config_resolve(config, "world.conf");
    g_assert_cmpstr(path, ==, "/etc/rigs/world.conf");
}

TEST(options) {
    GError *error = NULL;
    g_autoptr(Config) config = config_parse(good, "/etc/rigs/rig.conf", &error);
    struct target target = {0};
    g_assert_true(
        options_parse(table, config_find(config, "axis", "turn table"), also, &target, &error));
    g_assert_no_error(error);
    g_assert_true(target.wraps);
    g_assert_cmpint(target.count, ==, 7);
    g_assert_cmpfloat(target.settle_ms, ==, 12.5);
    g_assert_cmpfloat(target.speed_deg_s, ==, -1000);
    g_assert_cmpstr(target.world, ==, "/etc/worlds/a.conf");
    g_assert_cmpint(target.kind, ==, 1);
    g_assert_cmpint(target.exposures_us.n, ==, 3);
    g_assert_cmpfloat(target.exposures_us.values[1], ==, 2000.5);
    g_assert_cmpuint(g_strv_length(target.lamps), ==, 2);
    g_assert_cmpstr(target.lamps[1], ==, "lamp 30");
    options_clear(table, &target);
    g_assert_null(target.title);

    options_defaults(table, &target);
    g_assert_cmpfloat(target.settle_ms, ==, 150);
    g_assert_cmpstr(target.title, ==, "a \"title\"");
    g_assert_cmpint(target.exposures_us.n, ==, 2);
    g_assert_cmpuint(g_strv_length(target.lamps), ==, 0);
    options_clear(table, &target);
    options_clear(table, &target);
}

struct wrong {
    const char *text;
    enum config_error code;
    const char *message; /* all of it */
};

static const struct wrong wrong_files[] = {
    {"id = 1\n[rig]\n", CONFIG_ERROR_SYNTAX,
     "r.conf:1: this line comes before the first [section]: move it into a section, or remove it"},
    {"[rig]\n[rig]\n", CONFIG_ERROR_SYNTAX,
     "r.conf:2: [rig] was given before, in line 1: merge the two"},
    {"[axis a]\n[axis\ta]\n", CONFIG_ERROR_SYNTAX,
     "r.conf:2: [axis\ta] was given before, in line 1: merge the two"},
    {"[rig]\na=1\n\na=2\n", CONFIG_ERROR_SYNTAX,
     "r.conf:4: [rig] a: was given before, in line 2: remove one of the two"},
    {"[rig\n", CONFIG_ERROR_SYNTAX, "r.conf:1: the heading lacks its ']' at the end: add it"},
    {"[rig] x\n", CONFIG_ERROR_SYNTAX,
     "r.conf:1: text follows the ']' of the heading: move it to the next line"},
    {"[]\n", CONFIG_ERROR_SYNTAX,
     "r.conf:1: \"[]\" is not the heading of a section: write [class] or [class name]"},
    {"[rig]\nwords\n", CONFIG_ERROR_SYNTAX,
     "r.conf:2: [rig]: this line is neither \"key = value\" nor a [section]: correct or remove "
     "this line"},
    {"[rig]\n= 3\n", CONFIG_ERROR_SYNTAX,
     "r.conf:2: [rig]: \"\" is not a key: a key consists of letters, digits, '_', '-' and '.'"},
    {"[rig]\n\n# \xff\n", CONFIG_ERROR_SYNTAX,
     "r.conf:3: this line is not text in UTF-8: save the file as UTF-8"},
    {"[rig]\na = \x01\n", CONFIG_ERROR_SYNTAX,
     "r.conf:2: this line contains the control character with the number 1: remove it"},
};

TEST(wrong_files) {
    for (gsize i = 0; i < G_N_ELEMENTS(wrong_files); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(config_parse(wrong_files[i].text, "r.conf", &error));
        g_assert_error(error, CONFIG_ERROR, (int)wrong_files[i].code);
        g_assert_cmpstr(error->message, ==, wrong_files[i].message);
    }
}

#define GIVEN "[axis a]\nspeed_deg_s = 1\n"

static const struct wrong wrong_values[] = {
    {"[axis a]\n", CONFIG_ERROR_MISSING, "r.conf:1: [axis a] speed_deg_s: must be given: How fast"},
    {GIVEN "settle_s = 0.1", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] settle_s: the unit is part of the name: write settle_ms (in ms)"},
    {GIVEN "settle = 0.1", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] settle: the unit is part of the name: write settle_ms (in ms)"},
    {GIVEN "speed_rad_s = 0.1", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] speed_rad_s: the unit is part of the name: write speed_deg_s (in deg/s)"},
    {GIVEN "thata_deg = 3", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] thata_deg: there is no such key; did you mean theta_deg?"},
    {GIVEN "wrap = yes", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] wrap: there is no such key; did you mean wraps?"},
    {GIVEN "colour_of_the_bike_shed = red", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] colour_of_the_bike_shed: there is no such key in this section; remove the "
     "key"},
    {GIVEN "settle_ms = nan", CONFIG_ERROR_VALUE,
     "r.conf:3: [axis a] settle_ms: \"nan\" is not a number (its unit is ms; write only the "
     "number)"},
    {GIVEN "settle_ms = inf", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms = 1e999", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms = 0x10", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms = 1,5", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms = 150 ms", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms =", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "settle_ms = 1000.5", CONFIG_ERROR_VALUE,
     "r.conf:3: [axis a] settle_ms: 1000.5 is out of range: 0 to 1000 ms"},
    {GIVEN "settle_ms = -0.1", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "count = 2.5", CONFIG_ERROR_VALUE,
     "r.conf:3: [axis a] count: \"2.5\" is not a whole number"},
    {GIVEN "count = 0", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "count = 99999999999999999999", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "count = 4294967297", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "wraps = perhaps", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "kind = new", CONFIG_ERROR_UNKNOWN,
     "r.conf:3: [axis a] kind: there is no \"new\"; choose from: old, relabelled"},
    {GIVEN "exposures_us = 1;;2", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "exposures_us = 1;0;2", CONFIG_ERROR_VALUE, NULL},
    {GIVEN "title = x\nlamps = ;", CONFIG_ERROR_VALUE, NULL},
};

TEST(wrong_values) {
    for (gsize i = 0; i < G_N_ELEMENTS(wrong_values); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(Config) config = config_parse(wrong_values[i].text, "r.conf", &error);
        g_assert_no_error(error);
        struct target target = {0};
        g_assert_false(
            options_parse(table, config_find(config, "axis", "a"), also, &target, &error));
        g_assert_error(error, CONFIG_ERROR, (int)wrong_values[i].code);
        if (wrong_values[i].message)
            g_assert_cmpstr(error->message, ==, wrong_values[i].message);
        g_assert_true(g_str_has_prefix(error->message, "r.conf:"));
        g_assert_null(target.title);
        g_assert_null(target.lamps);
        g_assert_null(target.exposures_us.values);
    }
}

/* Numbers have a point, whatever the user's language. */
TEST(locale) {
    static const char *const locales[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "C"};
    for (gsize i = 0; i < G_N_ELEMENTS(locales); i++) {
        setlocale(LC_ALL, locales[i]);
        struct target target = {0};
        g_autoptr(Config) config =
            config_parse("[a]\nspeed_deg_s = 2.75\nsettle_ms = 0.5", "r.conf", NULL);
        g_assert_true(options_parse(table, config_find(config, "a", NULL), NULL, &target, NULL));
        g_assert_cmpfloat(target.speed_deg_s, ==, 2.75);
        options_clear(table, &target);
        g_autoptr(GString) json = g_string_new(NULL);
        options_describe_json(table, json);
        g_assert_null(strstr(json->str, "0,5"));
    }
}

TEST(describe) {
    g_autoptr(GString) text = g_string_new(NULL), json = g_string_new(NULL);
    options_describe(table, text);
    g_assert_nonnull(strstr(text->str, "settle_ms: number, 0 to 1000 ms; default 150\n"));
    g_assert_nonnull(strstr(text->str, "speed_deg_s: number deg/s; must be given\n"));
    g_assert_nonnull(strstr(text->str, "kind: choice of: old, relabelled; default old\n"));
    options_describe_json(table, json);
    g_assert_nonnull(strstr(json->str, "\"choices\":[\"old\",\"relabelled\"]"));
    g_assert_nonnull(strstr(json->str, "\"default\":\"a \\\"title\\\"\""));
    g_assert_nonnull(strstr(json->str, "\"min\":0,\"max\":1000"));
}

/* Bytes as they are, NULs too; length −1: up to the first. */
static char *write_bytes(const char *bytes, gssize length) {
    char *path = NULL;
    const int fd = g_file_open_tmp("mesorig-config-XXXXXX", &path, NULL);
    g_assert_cmpint(fd, >=, 0);
    g_close(fd, NULL);
    g_assert_true(g_file_set_contents(path, bytes, length, NULL));
    return path;
}

static Config *load_bytes(const char *bytes, gssize length, GError **error) {
    g_autofree char *path = write_bytes(bytes, length);
    Config *config = config_load(path, error);
    g_unlink(path);
    return config;
}

TEST(load) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Config) config = load_bytes("\xef\xbb\xbf[rig]\r\nid = x\r\n", -1, &error);
    g_assert_no_error(error);
    g_assert_cmpstr(config_value(config_find(config, "rig", NULL), "id", NULL), ==, "x");
    g_assert_null(load_bytes("[rig]\nid = \0\n", 13, &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_SYNTAX);
    g_assert_true(g_str_has_suffix(
        error->message,
        ":2: this line contains a NUL byte, so the file is not a text: copy the file again"));
    g_clear_error(&error);

    gsize size = 1024 * 1024;
    g_autofree char *big = g_strnfill(size + 1, '#');
    for (gsize i = 63; i <= size; i += 64)
        big[i] = '\n';
    g_autoptr(Config) largest = load_bytes(big, (gssize)size, &error);
    g_assert_no_error(error);
    g_assert_nonnull(largest);
    g_assert_null(load_bytes(big, (gssize)size + 1, &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_SYNTAX);
    g_clear_error(&error);
    g_assert_null(config_parse(big, "big.conf", &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_SYNTAX);
    g_clear_error(&error);

    g_assert_null(config_load("/nowhere/rig.conf", &error));
    g_assert_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT);
    g_clear_error(&error);
    g_assert_null(config_load("/tmp", &error));
    g_assert_nonnull(error);
    config_free(NULL);
}

static void mutate(GString *text) {
    static const char *const pieces[] = {"[",  "]",  "=",   "\n", ";",    "#", "nan", "1e999",
                                         "\r", "[a", "_ms", "-",  "\xc3", "é", " ",   "\t"};
    int n = g_test_rand_int_range(1, 8);
    for (int i = 0; i < n && text->len > 0; i++) {
        gssize at = g_test_rand_int_range(0, (gint32)text->len);
        gssize length = g_test_rand_int_range(1, 20);
        switch (g_test_rand_int_range(0, 4)) {
        case 0:
            text->str[at] = (char)g_test_rand_int_range(0, 256);
            break;
        case 1:
            g_string_erase(text, at, MIN((gssize)text->len - at, length));
            break;
        case 2:
            g_string_insert(text, at,
                            pieces[g_test_rand_int_range(0, (gint32)G_N_ELEMENTS(pieces))]);
            break;
        default:
            g_string_truncate(text, (gsize)at);
            break;
        }
    }
}

/* Whatever is in a file, it is read or refused with its line; numbers read are within their range.
 */
TEST(mutations) {
    int n_read = 0, n_refused = 0;
    for (int i = 0; i < 4000; i++) {
        g_autoptr(GString) text = g_string_new(good);
        mutate(text);
        g_autoptr(GError) error = NULL;
        g_autoptr(Config) config = config_parse(text->str, "r.conf", &error);
        gsize n = 0;
        const struct config_section *sections = config ? config_sections(config, &n) : NULL;
        g_assert_true((config == NULL) == (error != NULL));
        for (gsize j = 0; j < n; j++) {
            struct target target = {0};
            g_autoptr(GError) wrong = NULL;
            if (options_parse(table, &sections[j], also, &target, &wrong)) {
                g_assert_true(target.settle_ms >= 0 && target.settle_ms <= 1000);
                g_assert_true(target.count >= 1 && target.count <= 20);
                options_clear(table, &target);
                n_read++;
            } else {
                g_assert_true(g_str_has_prefix(wrong->message, "r.conf:"));
                g_assert_true(g_utf8_validate(wrong->message, -1, NULL));
                n_refused++;
            }
        }
    }
    g_assert_cmpint(n_read, >, 100);
    g_assert_cmpint(n_refused, >, 100);
}

TEST(frame) {
    Frame *frame = frame_new(3, 2);
    g_assert_true(frame_ref(frame) == frame);
    frame_unref(frame);
    frame_unref(frame);
    frame_unref(NULL);
    enum cfa cfa;
    for (int i = CFA_MONO; i <= CFA_GBRG; i++) {
        g_assert_true(cfa_parse(cfa_name((enum cfa)i), &cfa));
        g_assert_cmpint(cfa, ==, i);
    }
    g_assert_false(cfa_parse("rgb", &cfa));
    const char letters[] = "RGB";
    for (int i = CFA_RGGB; i <= CFA_GBRG; i++) {
        g_autofree char *name = g_ascii_strup(cfa_name((enum cfa)i), -1);
        for (int y = 0; y < 4; y++)
            for (int x = 0; x < 4; x++)
                g_assert_cmpint(letters[cfa_colour_at((enum cfa)i, x, y)], ==,
                                name[(y % 2) * 2 + x % 2]);
    }
}

/* What is wrong is left out, and takes nothing else with it. */
TEST(lenient) {
    g_autofree char *path = write_bytes("id = early\n"     /* 1: before any section */
                                        "[rig]\n"          /* 2 */
                                        "id = \xff demo\n" /* 3: not UTF-8, kept otherwise */
                                        "nonsense\n"       /* 4 */
                                        "[laser top\n"     /* 5 */
                                        "driver = a\n"     /* 6 */
                                        "coil = 3\n"       /* 7 */
                                        "coil = 4\n"       /* 8: the first one counts */
                                        "driver = b\n"     /* 9: a heading is missing */
                                        "coil = 5\n"       /* 10 */
                                        "[rig]\n"          /* 11: once more */
                                        "id = other\n"     /* 12 */
                                        "key = \x01\n",    /* 13: a control character */
                                        -1);
    static const int lines[] = {1, 4, 5, 8, 9, 11, 13};
    g_autoptr(GError) error = NULL;
    g_assert_null(config_load(path, &error));
    g_clear_error(&error);
    g_autoptr(Config) config = config_load_lenient(path, &error);
    g_assert_no_error(error);
    g_unlink(path);
    gsize n;
    const struct config_problem *problems = config_problems(config, &n);
    g_assert_cmpuint(n, ==, G_N_ELEMENTS(lines));
    for (gsize i = 0; i < n; i++)
        g_assert_cmpint(problems[i].line, ==, lines[i]);
    g_assert_nonnull(
        strstr(problems[3].message, ":8: [laser top (line 5)] coil: was given before"));
    const struct config_section *rig = config_find(config, "rig", NULL);
    g_assert_null(rig); /* there are two */
    const struct config_section *sections = config_sections(config, &n);
    g_assert_cmpuint(n, ==, 4);
    g_assert_cmpstr(sections[1].class_name, ==, "laser");
    g_assert_cmpstr(config_value(&sections[1], "coil", NULL), ==, "3");
    g_assert_cmpstr(sections[2].class_name, ==, CONFIG_NO_HEADING);
    g_assert_cmpstr(config_value(&sections[2], "driver", NULL), ==, "b");
    g_assert_cmpstr(config_value(&sections[2], "coil", NULL), ==, "5");
    g_assert_cmpstr(config_value(&sections[3], "id", NULL), ==, "other");
    g_assert_null(config_load_lenient("/no/such/rig.conf", &error));
    g_assert_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT);
}
