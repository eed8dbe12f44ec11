/* The manual pages: they render without a warning, their examples are files that the programs read,
 * and those that are generated have all drivers, keys and files. */
#include "drivers/device.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "plan/plan.h"
#include "rig/devices.h"
#include "world/world.h"

#include <sqlite3.h>
#include <string.h>

#include "lib/process.h"
#include "lib/remove_tree.h"

#define BUILT  BUILD_DIR "/etc/man"
#define SOURCE SOURCE_DIR "/etc/man"

static char *page_text(const char *name) {
    g_autofree char *path = g_build_filename(BUILT, name, NULL);
    char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return text;
}

/* Without a word on standard error, or on any output for mandoc. */
static void render(const char *path, gboolean lint) {
    const char *const groff[] = {"groff", "-k", "-ww", "-mandoc", "-Tutf8", path, NULL};
    const char *const mandoc[] = {"mandoc", "-T", "lint", "-W", "warning", path, NULL};
    g_autofree char *out = NULL, *err = NULL, *page = NULL;
    g_assert_cmpint(process_run(groff, &page, &err), ==, 0);
    g_assert_cmpstr(err, ==, "");
    g_assert_cmpuint(strlen(page), >, 500);
    if (lint && process_run(mandoc, &out, NULL) != 0)
        g_error("%s", out);
}

TEST(rendering) {
    static const char *const folders[] = {SOURCE, BUILT};
    int n = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autoptr(GDir) dir = g_dir_open(folders[i], 0, NULL);
        g_assert_nonnull(dir);
        for (const char *name; (name = g_dir_read_name(dir));) {
            g_autofree char *path = g_build_filename(folders[i], name, NULL);
            const char *dot = strrchr(name, '.');
            if (!dot || !strchr("158", dot[1]) || dot[2])
                continue;
            render(path, i == 1);
            n++;
        }
    }
    g_assert_cmpint(n, >=, 11);
}

/* The first block of text as it is; g_free(). */
static char *example_of(const char *page) {
    static const char begin[] = ".Bd -literal -offset indent\n";
    const char *at = strstr(page, begin);
    const char *end = at ? strstr(at, ".Ed") : NULL;
    g_assert_nonnull(end);
    return g_strndup(at + strlen(begin), (gsize)(end - at) - strlen(begin));
}

TEST(examples) {
    g_autoptr(GError) error = NULL;
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    g_autofree char *rig_page = page_text("rig.conf.5"), *rig_conf = example_of(rig_page);
    ok(devices_parse_geometry(rig_conf, "rig.conf(5)", rig, ERR));
    g_assert_cmpint(rig->n_cameras, ==, 1);

    g_auto(SessionConf) conf = {0};
    g_autofree char *session_page = page_text("session.conf.5");
    g_autofree char *session_conf = example_of(session_page);
    ok(session_conf_parse(&conf, session_conf, "session.conf(5)", ERR));
    g_assert_cmpint(conf.n_views, ==, 5);

    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "world.conf", NULL);
    g_autofree char *world_page = page_text("world.conf.5"), *world_conf = example_of(world_page);
    g_assert_true(g_file_set_contents(path, world_conf, -1, NULL));
    g_autoptr(World) world = world_get(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(world_find_lamp(world, "lamp30"), ==, 0);
}

static void assert_keys(const char *page, const struct option *options) {
    for (; options->name; options++) {
        g_autofree char *item = g_strdup_printf("\n.It Ic %s No = ", options->name);
        assert_has(page, item);
    }
}

/* A class or a driver that a template forgets would be left out silently. */
TEST(complete) {
    static const char *const session[] = {"session", "sample", "views", "capture"};
    static const char *const world[] = {"world", "sample", "camera", "lamp", "laser", "mark"};
    static const char *const rig[] = {"rig", "lamps", "lamp", "camera", "laser", "mark"};
    g_autofree char *rig_page = page_text("rig.conf.5"), *world_page = page_text("world.conf.5");
    g_autofree char *session_page = page_text("session.conf.5");
    const struct driver_info *info;
    gsize n = 0;
    for (; (info = devices_driver(n)); n++) {
        g_autofree char *head =
            g_strdup_printf("\n.Ss %s NAME: driver = %s\n", info->class_name, info->name);
        assert_has(rig_page, head);
        assert_keys(strstr(rig_page, head), info->options);
    }
    g_assert_cmpuint(n, >=, 14);
    for (gsize i = 0; i < G_N_ELEMENTS(rig); i++)
        assert_keys(rig_page, devices_section_options(rig[i]));
    for (gsize i = 0; i < G_N_ELEMENTS(session); i++)
        assert_keys(session_page, session_conf_options(session[i]));
    for (gsize i = 0; i < G_N_ELEMENTS(world); i++)
        assert_keys(world_page, world_section_options(world[i]));
}

/* The item ".It Ic a , b" or ".It Pa …" with this name. */
static void assert_item(const char *page, const char *macro, const char *name) {
    g_autofree char *quoted = g_regex_escape_string(name, -1);
    g_autofree char *pattern = g_strdup_printf("^\\.It %s (.* , )?%s( , .*)?$", macro, quoted);
    if (!g_regex_match_simple(pattern, page, G_REGEX_MULTILINE, 0))
        g_error("session(5) does not describe %s", name);
}

/* Returns the section of a page with this anchor, up to the next one; g_free(). */
static char *section_of(const char *page, const char *anchor) {
    for (const char *at = page; (at = strstr(at, "\n## ")); at++) {
        g_autofree char *heading = g_strndup(at + 4, strcspn(at + 4, "\n"));
        g_autofree char *lower = g_ascii_strdown(heading, -1);
        g_autofree char *slug = g_strdelimit(g_strdup(lower), " ", '-');
        const char *end = strstr(at + 1, "\n## ");
        if (strcmp(slug + 1, anchor) == 0 || strcmp(slug, anchor) == 0)
            return end ? g_strndup(at, (gsize)(end - at)) : g_strdup(at);
    }
    g_error("devices.md has no section #%s", anchor);
}

/* docs/build-a-rig/devices.md has a section for every driver, with the same headings in each, and
 * names every recording. */
TEST(devices) {
    static const char *const headings[] = {"\n### Devices known\n", "\n### Wiring\n",
                                           "\n### Options\n", "\n### What was tested\n",
                                           "\n### Check first\n"};
    g_autofree char *page = NULL;
    const struct driver_info *info;
    ok(g_file_get_contents(SOURCE_DIR "/docs/build-a-rig/devices.md", &page, NULL, ERR));
    for (gsize i = 0; (info = devices_driver(i)); i++) {
        if (g_str_has_prefix(info->name, "sim-"))
            continue;
        g_autofree char *pattern =
            g_strdup_printf("^\\|.*`%s`.*\\(#([a-z0-9-]+)\\) \\|$", info->name);
        g_autoptr(GRegex) row = g_regex_new(pattern, G_REGEX_MULTILINE, 0, NULL);
        g_autoptr(GMatchInfo) match = NULL;
        if (!g_regex_match(row, page, 0, &match))
            g_error("the table of devices.md does not have %s", info->name);
        g_autofree char *anchor = g_match_info_fetch(match, 1);
        g_autofree char *section = section_of(page, anchor);
        const char *at = section;
        for (gsize k = 0; k < G_N_ELEMENTS(headings); k++)
            if (!(at = strstr(at, headings[k])))
                g_error("#%s lacks%sor has it too early", anchor, headings[k]);
    }
    g_autoptr(GDir) folder = ok(g_dir_open(SOURCE_DIR "/tests/recordings", 0, ERR));
    for (const char *name; (name = g_dir_read_name(folder));) {
        g_autofree char *quoted = g_strdup_printf("`%s`", name);
        if (g_str_has_suffix(name, ".rec"))
            assert_has(page, quoted);
    }
}

/* What a session has, and what the page has: every value's key and every file. */
TEST(session) {
    static const struct {
        const char *pattern, *item;
    } files[] = {{"^frames/[0-9]{6}_cam[0-9]+\\.exr$", "frames/SHOT_CAMERA.exr"},
                 {"^laser/[0-9]{6}_cam[0-9]+\\.exr$", "laser/SHOT_CAMERA.exr"},
                 {"^products/btf/view_[0-9]{4}\\.exr$", "products/btf/view_0000.exr"}};
    g_autofree char *page = page_text("session.5");
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = g_build_filename(folder, "small.session", NULL);
    g_autofree char *path = g_build_filename(session, "session.db", NULL);
    g_free(process_mesorig(0,
                           "capture %s/tests/small/rig.conf %s/tests/small/session.conf -o %s "
                           "--process",
                           SOURCE_DIR, SOURCE_DIR, session));
    const char *const find[] = {"find", session, "-type", "f", "-printf", "%P\n", NULL};
    g_autofree char *list = process_text(0, find);
    g_auto(GStrv) names = g_strsplit(g_strchomp(list), "\n", -1);
    g_assert_cmpuint(g_strv_length(names), >, 20);
    for (char **name = names; *name; name++) {
        const char *item = *name;
        for (gsize i = 0; i < G_N_ELEMENTS(files); i++)
            if (g_regex_match_simple(files[i].pattern, *name, 0, 0))
                item = files[i].item;
        assert_item(page, "Pa", item);
    }
    sqlite3 *db = NULL;
    sqlite3_stmt *values = NULL;
    int n = 0;
    g_assert_cmpint(sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_prepare_v2(db, "SELECT key FROM value", -1, &values, NULL), ==,
                    SQLITE_OK);
    for (; sqlite3_step(values) == SQLITE_ROW; n++)
        assert_item(page, "Ic", (const char *)sqlite3_column_text(values, 0));
    g_assert_cmpint(n, >, 10);
    sqlite3_finalize(values);
    /* The tables as SQLite has them, not as the page was made. */
    g_assert_cmpint(sqlite3_prepare_v2(db,
                                       "SELECT m.name, c.name, c.type FROM sqlite_schema m, "
                                       "pragma_table_info(m.name) c WHERE m.type = 'table'",
                                       -1, &values, NULL),
                    ==, SQLITE_OK);
    for (n = 0; sqlite3_step(values) == SQLITE_ROW; n++) {
        g_autofree char *head =
            g_strdup_printf("\n.Ss Table %s\n", (const char *)sqlite3_column_text(values, 0));
        g_autofree char *column =
            g_strdup_printf("\n.It Ic %s No %s", (const char *)sqlite3_column_text(values, 1),
                            (const char *)sqlite3_column_text(values, 2));
        assert_has(page, head);
        assert_has(strstr(page, head), column);
    }
    g_assert_cmpint(n, >, 40);
    sqlite3_finalize(values);
    sqlite3_close(db);
}
