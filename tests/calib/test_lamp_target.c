/* The descriptions of targets for the calibration of lamps: all mistakes of a file are reported
 * with their lines. */
#include "lamps/lamps.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <string.h>

static gboolean load(const char *text, struct lamp_target *ret, GError **error) {
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "mesorig-target-XXXXXX", NULL);
    const int file = g_mkstemp(path);
    g_assert_cmpint(file, >=, 0);
    g_close(file, NULL);
    ok(g_file_set_contents(path, text, -1, ERR));
    const gboolean good = lamp_target_load(ret, path, error);
    g_unlink(path);
    return good;
}

TEST(shipped) {
    struct lamp_target poles, balls;
    ok(lamp_target_load(&poles, SOURCE_DIR "/etc/demo/poles.conf", ERR));
    g_assert_cmpint(poles.kind, ==, LAMP_POLES);
    g_assert_cmpint(poles.n, ==, 8);
    g_assert_cmpfloat(poles.plate_mm[1], ==, 84);
    g_assert_cmpfloat(poles.radius_mm, ==, 1);
    g_assert_cmpfloat(poles.tolerance_mm, ==, 0.02);
    g_assert_cmpfloat(poles.marks[7].y_mm, ==, 4);
    g_assert_cmpfloat(poles.marks[7].size_mm, ==, 5);
    ok(lamp_target_load(&balls, SOURCE_DIR "/etc/demo/balls.conf", ERR));
    g_assert_cmpint(balls.kind, ==, LAMP_BALLS);
    g_assert_cmpfloat(balls.tolerance_mm, ==, 0.005);
}

TEST(tolerance) {
    struct lamp_target target;
    ok(load("[target]\nkind = balls\nplane_mm = 0\nplaces_mm = 1;2;8\ntolerance_mm = 0.01\n",
            &target, ERR));
    g_assert_cmpfloat(target.tolerance_mm, ==, 0.01);
    g_assert_cmpint(target.n, ==, 1);
}

TEST(mistakes) {
    static const struct {
        const char *text, *says[3];
    } cases[] = {
        {"[target]\nkind = cones\nplane_mm = x\nplaces_mm = 1;2;8\n",
         {":2: [target] kind: there is no \"cones\"; choose from: poles, balls",
          ":3: [target] plane_mm: \"x\" is not a number"}},
        {"[target]\nkind = balls\nplane_cm = 2\nplaces_mm = 1;2;8\n",
         {":3: [target] plane_cm: the unit is part of the name: write plane_mm"}},
        {"[target]\nkind = balls\nplane_mm = 0.002\nplaces_mm = 1;2;0.008;1;2;8\n",
         {":3: [target] plane_mm: 0.002 mm is too small for the height",
          ":4: [target] places_mm: the height or radius of post or ball 1 is 0.008 mm",
          ":4: [target] places_mm: posts or balls 1 and 2 have the same position"}},
        {"[target]\nkind = balls\nplane_mm = 2\nplaces_mm = 1;2\n",
         {":4: [target] places_mm: 2 numbers are given: give x; y; height"}},
        {"[target]\nkind = poles\nplane_mm = 2\nplate_mm = 84\nplaces_mm = 1;2;8\n",
         {"[target] radius_mm: 0 mm is no radius of posts",
          ":4: [target] plate_mm: 1 numbers are given: give two, the size of"}},
        {"[session]\nname = x\n",
         {"the file has no section [target]; see poles.conf and balls.conf in "
          "/usr/share/mesorig/demo"}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct lamp_target target;
        g_autoptr(GError) error = NULL;
        g_assert_false(load(cases[i].text, &target, &error));
        for (int k = 0; k < 3 && cases[i].says[k]; k++)
            if (!strstr(error->message, cases[i].says[k]))
                g_error("“%s” is not in: %s", cases[i].says[k], error->message);
    }
}
