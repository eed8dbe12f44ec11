/* The metadata of a picture that the viewer has saved. */
#include "exr/exr.h"
#include "lib/test.h"
#include "window/snapshot.h"

#include <glib/gstdio.h>
#include <locale.h>

#include "lib/remove_tree.h"
#include "lib/skip.h"

/* A locale whose decimal point is a comma, made here, since a machine may have none. */
static gboolean use_comma(const char *folder) {
    g_autofree char *source = g_build_filename(folder, "comma", NULL);
    g_autofree char *locale = g_build_filename(folder, "xx_XX", NULL);
    const char *const argv[] = {"localedef",      "-c",   "--quiet", "-i", source, "-f",
                                "ANSI_X3.4-1968", locale, NULL};
    g_assert_true(g_file_set_contents(source,
                                      "LC_NUMERIC\ndecimal_point \",\"\nthousands_sep \".\"\n"
                                      "grouping 3;3\nEND LC_NUMERIC\n",
                                      -1, NULL));
    g_spawn_sync(NULL, (char **)argv, NULL,
                 G_SPAWN_SEARCH_PATH | G_SPAWN_STDOUT_TO_DEV_NULL | G_SPAWN_STDERR_TO_DEV_NULL,
                 NULL, NULL, NULL, NULL, NULL, NULL);
    g_setenv("LOCPATH", folder, TRUE);
    const gboolean is_used = setlocale(LC_NUMERIC, "xx_XX") != NULL;
    g_unsetenv("LOCPATH"); /* newlocale() of glibc does not free what it makes of it */
    return is_used;
}

/* The texts have decimal points, and the user's own numbers are as before. */
TEST(comma) {
    static const float rgb[3] = {0.5F, 0.5F, 0.5F};
    static const struct method method = {.title = "a method"};
    static const struct viewer_options options = {NULL};
    struct viewer_settings settings = viewer_settings_default;
    const struct snapshot snapshot = {.material = "a.exr",
                                      .shape = "torus",
                                      .first = &method,
                                      .settings = &settings,
                                      .options = &options};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "a.exr", NULL);
    const char *tiles = NULL;
    if (!use_comma(folder)) {
        test_skip_or_fail("localedef makes no locale here");
        remove_tree(folder);
        return;
    }
    settings.tiles_u = 6.25F;
    settings.tiles_v = 2.5F;
    g_assert_true(snapshot_write(path, &snapshot, NULL, rgb, 1, 1, NULL));
    struct exr_part *part = exr_read_part(path, "picture", NULL);
    g_assert_nonnull(part);
    g_assert_true(exr_get_string(part, "picture.tiles", &tiles, NULL));
    g_assert_cmpstr(tiles, ==, "6.25 x 2.5");
    exr_part_free(part);
    g_autofree char *own = g_strdup_printf("%.1f", 1.5);
    g_assert_cmpstr(own, ==, "1,5");
    setlocale(LC_NUMERIC, "C");
}
