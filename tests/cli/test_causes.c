/* mesorig process says why little was measured, in a sentence with a number and the key to change.
 */
#include "calibration/calibration.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "rig/devices.h"

#include <sqlite3.h>
#include <string.h>

/* A session with other keys, captured and processed; what process says is run->out. */
static struct operation *captured(gboolean responses, const struct change *session,
                                  const struct change *world) {
    struct operation *run = operator_new(NULL);
    small_rig_write(run->directory, "session.conf", session);
    small_rig_write(run->directory, "world.conf", world);
    if (!responses) { /* the first camera's is a comment */
        g_autofree char *text = NULL;
        g_assert_true(g_file_get_contents(run->rig, &text, NULL, NULL));
        *strstr(text, "response = ") = '#';
        g_assert_true(g_file_set_contents(run->rig, text, -1, NULL));
    }
    operator_captures(run, 0);
    operator_does(run, 0, "process", run->session, NULL);
    g_test_message("%s", run->out);
    return run;
}

static void sql(const struct operation *run, const char *text) {
    g_autofree char *path = g_build_filename(run->session, "session.db", NULL);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, text, NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
}

/* A camera whose lens is all but covered; the other's sweeps are right at first. */
TEST(dark) {
    struct operation *run =
        captured(TRUE, NULL, (const struct change[]){{"[camera cam60]", "response = 0.01"}, {0}});
    assert_has(run->out, "2 of 4 views (the first is view 2, 60° from the normal, camera cam60) "
                         "are dark: a picture of the first is ");
    assert_has(run->out, "at 16000 µs; set longer exposures_us in [capture] of the session file, "
                         "and look whether the lens of camera cam60 is open");
    g_assert_null(strstr(run->out, "saturated: "));
    g_assert_null(strstr(run->out, "by a common factor"));
    operator_does(run, 0, "process", run->session, "--json", NULL); /* nothing is made again */
    assert_has(run->out, "\"causes\": [\"2 of 4 views");
    sql(run, "UPDATE grid SET depth_mm = 0, reference_mm = reference_mm + 5; DELETE FROM product");
    operator_does(run, 0, "process", run->session, NULL);
    assert_has(run->out, "of the pixels show a line, but not between the reference plane at 10 mm "
                         "and depth_mm = 0 below it; correct reference_mm and depth_mm in");
    operator_free(run);
}

/* Saturated pictures of cameras whose response nobody has given, and lasers that no camera sees. */
TEST(saturated) {
    static const struct change session[] = {
        {"[capture]", "exposures_us = 4000000"}, {"[capture]", "laser_threshold_dn = 4000"}, {0}};
    struct operation *run = captured(FALSE, session, NULL);
    assert_has(
        run->out,
        "saturated: 100 % of the values of the first are lower bounds; add a shorter exposure to "
        "exposures_us in [capture]");
    assert_has(run->out, "no texel is seen by a laser: 0 % of the pixels of 8 sweeps show a line; "
                         "set a longer laser_exposure_us or a lower laser_threshold_dn");
    assert_has(run->out, "response of [camera cam30] = 1 is the default (1 of 2 cameras)");
    g_assert_null(strstr(run->out, "dark: "));
    operator_free(run);
}

/* Pictures that are bright, and a response that makes little of them. */
TEST(large_response) {
    struct operation *run = captured(TRUE, NULL, NULL);
    g_autofree char *path = g_build_filename(run->directory, "large.conf", NULL);
    g_autoptr(GError) error = NULL;
    struct rig rig;
    g_assert_false(strstr(run->out, "dark: ") || strstr(run->out, "saturated: ") ||
                   strstr(run->out, "seen by a laser") || strstr(run->out, "by a common factor"));
    g_assert_true(devices_read_geometry(run->rig, &rig, &error));
    rig.cameras[1].response *= 1e5;
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    g_assert_true(calibration_write(calibration, path, &error));
    operator_does(run, 0, "process", run->session, "-c", path, NULL);
    assert_has(run->out, "2 of 4 views (the first is view 2, 60° from the normal, camera "
                         "cam60) are dark: ");
    assert_has(run->out, "response of [camera cam60] = 6e+08 or the intensity of the lamps is too "
                         "large: measure a white tile");
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
