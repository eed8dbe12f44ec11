/* For a rig, session or world file with many mistakes, the error lists all of them in the order of
 * the lines. Each mistake has the same text as if it were the only one. A mistake that only follows
 * from another one is not listed. */
#include "base/options.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "plan/plan.h"
#include "rig/devices.h"
#include "world/world.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <string.h>

static char *folder;

/* Reads a file from its text. Returns TRUE if the file has no mistake. */
typedef gboolean (*Reader)(const char *text, const char *path, GError **error);

static gboolean read_rig(const char *text, const char *path, GError **error) {
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    return devices_parse_geometry(text, path, rig, error);
}

static gboolean read_session(const char *text, const char *path, GError **error) {
    g_auto(SessionConf) conf = {0};
    return session_conf_parse(&conf, text, path, error);
}

static gboolean read_world(const char *text, const char *path, GError **error) {
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_autoptr(World) world = world_get(path, error);
    g_unlink(path);
    return world != NULL;
}

/* As many lines as before, so that mistakes do not move each other. */
struct mistake {
    const char *from, *to;
    const char *at;   /* the reported line begins with this; NULL: the first line of to */
    const char *says; /* among other words */
};

static const struct mistake rig_mistakes[] = {
    {"arc_width_mm = 30", "arc_width_mm = wide", NULL, "arc_width_mm: \"wide\" is not a number"},
    {"speed_deg_s = 60", "speed_dge_s = 60", NULL, "did you mean speed_deg_s?"},
    {"settle_ms = 200", "settle_s = 0.2", NULL, "write settle_ms (in ms)"},
    {"driver = sim-lamps", "driver = sim-lmaps", NULL, "there is no driver \"sim-lmaps\""},
    {"bank = bank\nindex = 0", "bank = bnk\nindex = 0", NULL, "there is no section [lamps bnk]"},
    {"index = 1", "# nothing", "[lamp lamp60]", "[lamp lamp60] index: must be given"},
    {"width = 32\nheight = 32", "width 32\nheight = 32", NULL, "neither \"key = value\" nor"},
    {"theta_deg = 60\nphi_deg = 0", "theta_deg = 95\nphi_deg = 0", NULL, "95 is out of range"},
    {"sweep = sweep30", "sweep = sweep31", NULL, "there is no section [axis sweep31]"},
};

static const struct mistake session_mistakes[] = {
    {"name = small", "name = a/b", NULL, "part of a file's name"},
    {"width_mm = 50", "width = 50", NULL, "write width_mm (in mm)"},
    {"texels = 8", "texels = 8.5", NULL, "is not a whole number"},
    {"height_mm = 50", "height_mm", NULL, "neither \"key = value\" nor"},
    {"[views]\nrings = 30:2", "[views]\nrings = 30:x", "rings = 30:x", "is not theta:count"},
    {"[lights]\nrings = 30:2; 60:2\noffset_deg = 45",
     "[lights]\nrings = 30:2; 60:2\nofset_deg = 45", "ofset_deg", "did you mean offset_deg?"},
    {"exposures_us = 4000; 16000", "exposures_us = 16000; 4000", NULL, "shortest exposure first"},
    {"retries = 3", "laser_short_us = 5000", NULL, "less than laser_exposure_us"},
};

static const struct mistake world_mistakes[] = {
    {"supersample = 1", "supersample = 9", NULL, "9 is out of range: 1 to 8"},
    {"kind = flat", "kind = flt", NULL, "there is no \"flt\""},
    {"[camera cam30]\ntheta_deg = 30\ndistance_mm = 650\nwidth = 32",
     "[camera cam30]\ntheta_deg = 30\ndistance_mm = 650\nwidth = 0", "width = 0", "out of range"},
    {"[lamp lamp30]\ntheta_deg = 30\ndistance_mm = 500",
     "[lamp lamp30]\ntheta_deg = 30\naim_deg = 1", "aim_deg = 1",
     "needs 2 numbers with ';' between them, but has 1"},
    {"[lamp lamp60]\ntheta_deg = 60\ndistance_mm", "[lamp lamp60]\ntheta_deg = 60\ndistnace_mm",
     "distnace_mm", "did you mean distance_mm?"},
    {"[laser laser30]\ntheta_deg = 30", "[laser laser30]\n?? = 30", "?? =", "is not a key"},
};

/* The first place where it stands is replaced; free with g_free(). */
static char *with_mistake(const char *text, const struct mistake *mistake) {
    g_auto(GStrv) around = g_strsplit(text, mistake->from, 2);
    if (!around[0] || !around[1])
        g_error("the file does not have “%s”", mistake->from);
    return g_strjoinv(mistake->to, around);
}

static int line_of(const char *text, const char *words) {
    const char *at = strstr(text, words);
    int line = 1;
    g_assert_nonnull(at);
    for (; text < at; text++)
        line += *text == '\n';
    return line;
}

struct told {
    int line;
    char *text;
};

static int by_line(gconstpointer a, gconstpointer b) {
    return ((const struct told *)a)->line - ((const struct told *)b)->line;
}

static char *file_of_kind(const char *kind) {
    g_autofree char *path = g_strconcat(SOURCE_DIR "/tests/small/", kind, NULL);
    char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return text;
}

static void check_kind(const char *kind, Reader read, const struct mistake *mistakes, gsize n) {
    g_autofree char *path = g_build_filename(folder, kind, NULL);
    g_autofree char *text = file_of_kind(kind), *all = g_strdup(text);
    g_autofree struct told *told = g_new0(struct told, n);
    g_autoptr(GError) error = NULL;
    g_assert_true(ok(read(text, path, ERR)));
    for (gsize i = 0; i < n; i++) {
        g_autofree char *one = with_mistake(text, &mistakes[i]);
        const char *at = mistakes[i].at ? mistakes[i].at : mistakes[i].to;
        told[i].line = line_of(one, at);
        g_autofree char *place = g_strdup_printf("%s:%d: ", path, told[i].line);
        g_assert_false(read(one, path, &error));
        g_test_message("%s", error->message);
        g_assert_true(g_str_has_prefix(error->message, place));
        g_assert_nonnull(strstr(error->message, mistakes[i].says));
        g_assert_null(strchr(error->message, '\n'));
        told[i].text = g_strdup(error->message);
        g_clear_error(&error);
        char *more = with_mistake(all, &mistakes[i]);
        g_free(all);
        all = more;
    }
    qsort(told, n, sizeof *told, by_line);
    g_autoptr(GString) expected = g_string_new(NULL);
    g_string_printf(expected, "%s: %u mistakes:", path, (guint)n);
    for (gsize i = 0; i < n; i++)
        g_string_append_printf(expected, "\n%s", told[i].text);
    g_assert_false(read(all, path, &error));
    g_assert_cmpstr(error->message, ==, expected->str);
    g_assert_true(error->domain == CONFIG_ERROR);
    for (gsize i = 0; i < n; i++)
        g_free(told[i].text);
}

TEST(rig) {
    check_kind("rig.conf", read_rig, rig_mistakes, G_N_ELEMENTS(rig_mistakes));
}

TEST(session) {
    check_kind("session.conf", read_session, session_mistakes, G_N_ELEMENTS(session_mistakes));
}

TEST(world) {
    check_kind("world.conf", read_world, world_mistakes, G_N_ELEMENTS(world_mistakes));
}

/* Each mistake makes something else seem to be missing, which must not be reported. */
TEST(consequences) {
    static const struct {
        const char *kind;
        Reader read;
        struct mistake mistake;
    } cases[] = {
        {"session.conf",
         read_session,
         {"[capture]", "[captur]", NULL, "there is no such section; did you mean [capture]?"}},
        {"session.conf", read_session, {"[capture]", "[capture", NULL, "lacks its ']'"}},
        {"session.conf", read_session, {"[capture]", "[sample]", "[sample]\nexp", "merge the two"}},
        {"session.conf", read_session, {"width_mm = 50", "width_mm 50", NULL, "nor a [section]"}},
        {"session.conf", read_session, {"texels = 8", "texels 8", NULL, "nor a [section]"}},
        {"session.conf",
         read_session,
         {"exposures_us =", "exposure_us =", NULL, "did you mean exposures_us?"}},
        {"session.conf", read_session, {"[session]", "[sesion]", NULL, "[session]?"}},
        {"rig.conf",
         read_rig,
         {"driver = sim-laser\nworld = world.conf", "driver = sim-laser\ndriver = sim-laser",
          "driver = sim-laser\nsweep", "driver: was given before"}},
        {"rig.conf", read_rig, {"[axis arc]", "[axis arc", NULL, "lacks its ']'"}},
        {"rig.conf",
         read_rig,
         {"[lamps bank]", "[lapms bank]", NULL, "did you mean [lamps NAME]?"}},
        {"rig.conf", read_rig, {"[rig]", "[rigg]", NULL, "did you mean [rig]?"}},
        {"rig.conf", read_rig, {"[camera cam30]", "[camera]", NULL, "needs a name"}},
        {"rig.conf", read_rig, {"sweep = sweep30", "swep = sweep30", NULL, "did you mean sweep?"}},
        {"world.conf", read_world, {"[sample]", "[smaple]", NULL, "did you mean [sample]?"}},
        {"world.conf", read_world, {"[sample]", "sample]", NULL, "neither \"key = value\""}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *path = g_build_filename(folder, cases[i].kind, NULL);
        g_autofree char *text = file_of_kind(cases[i].kind);
        const struct mistake *mistake = &cases[i].mistake;
        g_autofree char *wrong = with_mistake(text, mistake);
        g_autofree char *place = g_strdup_printf(
            "%s:%d: ", path, line_of(wrong, mistake->at ? mistake->at : mistake->to));
        g_autoptr(GError) error = NULL;
        g_assert_false(cases[i].read(wrong, path, &error));
        g_test_message("%s", error->message);
        g_assert_true(g_str_has_prefix(error->message, place));
        g_assert_nonnull(strstr(error->message, mistake->says));
        g_assert_null(strchr(error->message, '\n'));
    }
}

/* Twenty are shown, the others counted; a file of nothing but mistakes takes no time. */
TEST(many) {
    static const guint counts[] = {20, 21, 500, 20000};
    for (gsize i = 0; i < G_N_ELEMENTS(counts); i++) {
        g_autoptr(GString) text =
            g_string_new("[rig]\nid = x\n[camera top]\ndriver = sim-camera\n");
        for (guint k = 0; k < counts[i]; k++)
            g_string_append_printf(text, "x%u\n", k);
        g_string_append(text, "[lamps b]\ndriver = sim-lamps\nworld = w\n");
        g_autoptr(GError) error = NULL;
        g_assert_false(read_rig(text->str, "rig.conf", &error));
        g_auto(GStrv) lines = g_strsplit(error->message, "\n", -1);
        g_autofree char *head = NULL, *end = NULL;
        /* And one: there is neither lamp nor laser. */
        head = g_strdup_printf("rig.conf: %u mistakes:", counts[i] + 1);
        end = g_strdup_printf("and %u more", counts[i] + 1 - 20);
        g_assert_cmpstr(lines[0], ==, head);
        g_assert_cmpuint(g_strv_length(lines), ==, 22);
        g_assert_true(g_str_has_prefix(lines[1], "rig.conf:5: "));
        g_assert_true(g_str_has_prefix(lines[20], "rig.conf:24: "));
        g_assert_cmpstr(lines[21], ==, end);
    }
}

/* Lines are swapped, repeated, cut and overwritten. */
static char *mutated(const char *text) {
    static const char *const pieces[] = {"[",     "]",    "=", ";",     "nan", "-1",
                                         "1e999", "\xff", "x", "[rig]", "#",   "driver = sim-axis"};
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    const int n = (int)g_strv_length(lines);
    for (int i = g_test_rand_int_range(1, 12); i > 0; i--) {
        char **line = &lines[g_test_rand_int_range(0, n)];
        const int at = g_test_rand_int_range(0, (gint32)strlen(*line) + 1);
        const char *piece = pieces[g_test_rand_int_range(0, (gint32)G_N_ELEMENTS(pieces))];
        const char *other = lines[g_test_rand_int_range(0, n)];
        const int way = g_test_rand_int_range(0, 4);
        char *made = way == 0   ? g_strdup(other)
                     : way == 1 ? g_strndup(*line, (gsize)at)
                     : way == 2 ? g_strdup(piece)
                                : g_strdup_printf("%.*s%s%s", at, *line, piece, *line + at);
        g_free(*line);
        *line = made;
    }
    return g_strjoinv("\n", lines);
}

/* For any contents of a file, the stated number is that of the reported lines, these are in order,
 * no two are equal, and the whole text is UTF-8. */
TEST(mutations) {
    static const struct {
        const char *kind;
        Reader read;
        int n;
    } kinds[] = {{"rig.conf", read_rig, 500},
                 {"session.conf", read_session, 500},
                 {"world.conf", read_world, 60}};
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        g_autofree char *path = g_build_filename(folder, kinds[i].kind, NULL);
        g_autofree char *text = file_of_kind(kinds[i].kind);
        g_autofree char *begin = g_strdup_printf("%s:", path);
        int n_several = 0;
        for (int k = 0; k < kinds[i].n; k++) {
            g_autofree char *wrong = mutated(text);
            g_autoptr(GError) error = NULL;
            if (kinds[i].read(wrong, path, &error)) {
                g_assert_no_error(error);
                continue;
            }
            g_assert_true(g_utf8_validate(error->message, -1, NULL));
            g_assert_true(g_str_has_prefix(error->message, begin));
            g_auto(GStrv) lines = g_strsplit(error->message, "\n", -1);
            const int n = (int)g_strv_length(lines) - 1;
            if (n == 0)
                continue;
            int told = 0, last = 0;
            g_autoptr(GHashTable) seen = g_hash_table_new(g_str_hash, g_str_equal);
            g_assert_cmpint(sscanf(lines[0] + strlen(begin), " %d mistakes:", &told), ==, 1);
            g_assert_cmpint(MIN(told, MISTAKES_SHOWN) + (told > MISTAKES_SHOWN), ==, n);
            for (int j = 1; j <= MIN(told, MISTAKES_SHOWN); j++) {
                int line = 0;
                g_assert_true(g_hash_table_add(seen, lines[j]));
                g_assert_true(g_str_has_prefix(lines[j], begin));
                if (sscanf(lines[j] + strlen(begin), "%d:", &line) != 1)
                    line = G_MAXINT; /* of the file as a whole */
                g_assert_cmpint(line, >=, last);
                last = line;
            }
            n_several++;
        }
        g_assert_cmpint(n_several, >, kinds[i].n / 4);
    }
}

/* Copies of the error, as GTask and D-Bus make them, also have all mistakes. */
TEST(error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(GError) error = NULL;
    g_assert_true(ok(mistakes_report(mistakes, ERR)));
    g_assert_false(mistakes_add(mistakes, NULL));
    g_assert_cmpuint(mistakes_count(mistakes), ==, 0);
    mistakes_add(mistakes, g_error_new(G_FILE_ERROR, G_FILE_ERROR_NOENT, "there is no a.png"));
    g_assert_false(mistakes_report(mistakes, &error));
    g_assert_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT);
    g_clear_error(&error);
    mistakes_add(mistakes, g_error_new(G_FILE_ERROR, G_FILE_ERROR_NOENT, "there is no a.png"));
    g_assert_cmpuint(mistakes_count(mistakes), ==, 1);
    g_autoptr(Config) config = config_parse("[a]\nb = 1\n", "w.conf", NULL);
    config_mistake(mistakes, CONFIG_ERROR_VALUE, config_find(config, "a", NULL), "b", "is %d", 1);
    config_lacks(mistakes, config, "there is no [c]");
    g_assert_false(mistakes_report(mistakes, &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE);
    g_autoptr(GError) copy = g_error_copy(error);
    g_assert_cmpstr(copy->message, ==,
                    "w.conf: 3 mistakes:\nw.conf:2: [a] b: is 1\nthere is no a.png\n"
                    "w.conf: there is no [c]");
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-mistakes-XXXXXX", NULL);
}

AFTER_TESTS {
    g_rmdir(folder);
    g_free(folder);
}
