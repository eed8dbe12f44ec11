/* mesorig board and mesorig calibrate as a shell sees them, and captures that use a calibration. */
#include "calibration/calibration.h"
#include "lib/folder.h"
#include "lib/process.h"
#include "lib/test.h"
#include "rig/devices.h"
#include "session/session.h"

#include <glib/gstdio.h>
#include <string.h>

#define RIG     SOURCE_DIR "/tests/small/rig.conf"
#define SESSION SOURCE_DIR "/tests/small/session.conf"
#define MESORIG BUILD_DIR "/bin/mesorig"

/* What was printed, on stdout or else stderr; g_free(). */
#define RUN(code, ...) process_text(code, (const char *const[]){MESORIG, __VA_ARGS__, NULL})

/* A calibration of the small rig whose first camera stands a millimetre off. */
static struct calibration *example(void) {
    g_autoptr(GError) error = NULL;
    struct rig rig;
    g_assert_true(devices_read_geometry(RIG, &rig, &error));
    struct calibration *calibration = calibration_new(&rig);
    calibration->rig.cameras[0].translation_mm.x += 1;
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "a test", 7, "abc", NULL);
    return calibration;
}

TEST(capture) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *path = in_folder("small.calibration");
    g_autofree char *directory = in_folder("calibrated.session");
    calibration->parts[CALIBRATION_CAMERAS].date[3] = '0'; /* years ago */
    g_assert_true(calibration_write(calibration, path, &error));
    g_free(RUN(0, "capture", RIG, SESSION, "-o", directory, "-c", path));
    g_autoptr(Session) session = session_open(directory, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autofree char *wanted = calibration_to_text(calibration);
    g_assert_cmpstr(text, ==, wanted);
    g_autofree char *which = session_value(session, "calibration");
    g_assert_cmpstr(which, ==, path);
    g_autoptr(GPtrArray) events = session_events(session, &error);
    gboolean warned = FALSE;
    for (guint i = 0; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        warned |= strcmp(event->level, "warning") == 0 && strstr(event->message, "days old");
    }
    g_assert_true(warned);
}

TEST(capture_refuses) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *path = in_folder("other.calibration");
    g_autofree char *directory = in_folder("refused.session");
    g_strlcpy(calibration->rig.id, "other", sizeof calibration->rig.id);
    g_assert_true(calibration_write(calibration, path, &error));
    g_autofree char *other = RUN(1, "capture", RIG, SESSION, "-o", directory, "-c", path);
    assert_has(other, "a calibration of rig other, but this is rig small");
    g_assert_true(g_file_set_contents(path, "[rig]\nformat=mesorig-cal", -1, NULL));
    g_autofree char *cut = RUN(1, "capture", RIG, SESSION, "-o", directory, "-c", path);
    assert_has(cut, "not a calibration file of this version");
    g_unlink(path);
    g_autofree char *gone = RUN(1, "capture", RIG, SESSION, "-o", directory, "-c", path);
    assert_has(gone, "there is no calibration file");
    g_assert_false(g_file_test(directory, G_FILE_TEST_EXISTS));
}

TEST(show_and_report) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *path = in_folder("shown.calibration");
    g_autofree char *html = in_folder("report.html");
    g_autofree char *page = NULL;
    g_key_file_set_value(calibration->extra, "camera residuals 0", "x_px", "3;9");
    g_key_file_set_value(calibration->extra, "camera residuals 0", "y_px", "4;5");
    g_key_file_set_value(calibration->extra, "camera residuals 0", "dx_px", "0.1;0.2");
    g_key_file_set_value(calibration->extra, "camera residuals 0", "dy_px", "0.1");
    g_strlcpy(calibration->rig.cameras[0].name, "<cam&30>", RIG_NAME);
    g_assert_true(calibration_write(calibration, path, &error));
    g_autofree char *shown = RUN(0, "calibrate", "show", path);
    assert_has(shown, "7 pictures");
    assert_has(shown, "lamps and arc: not calibrated");
    g_autofree char *json = RUN(0, "calibrate", "show", path, "--json");
    assert_has(json, "\"pictures\": 7");
    g_free(RUN(0, "calibrate", "report", path, "-o", html));
    g_assert_true(g_file_get_contents(html, &page, NULL, NULL));
    assert_has(page, "<svg");
    assert_has(page, "&lt;cam&amp;30&gt;");
    g_assert_null(strstr(page, "<cam"));
    assert_has(page, "Calibrated: 1 of 4. To be looked at:");
    assert_has(page, "<li>laser: not calibrated, the values of the rig file are used</li>");
    g_unlink(html);
    g_free(RUN(2, "calibrate", "report", path));
    g_free(RUN(2, "calibrate", "nonsense"));
    g_free(RUN(1, "calibrate", "show", "/nowhere"));
    g_unlink(path);
}

/* The line at the page's top, and of many pictures that were left out a few. */
TEST(verdict) {
    g_autoptr(Calibration) calibration = example();
    g_autofree char *path = in_folder("verdict.calibration"), *html = in_folder("verdict.html");
    g_autofree char *good = NULL, *doubtful = NULL;
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibration_set_part(calibration, (enum calibration_kind)i, "a test", 7, "abc", NULL)
            ->degrees_of_freedom = 200;
    g_assert_true(calibration_write(calibration, path, NULL));
    g_free(RUN(0, "calibrate", "report", path, "-o", html));
    g_assert_true(g_file_get_contents(html, &good, NULL, NULL));
    assert_has(good,
               "</h1>\n<p class=\"good\">Everything is calibrated, and there are no warnings.");
    for (int i = 1; i <= 300; i++)
        g_ptr_array_add(calibration->parts[CALIBRATION_LIGHTS].rejected,
                        g_strdup_printf("%d.exr: ball 1 shows no lamp", i));
    calibration->noise[1] = (struct calibration_noise){.known = TRUE, .transfer.linearity = 0.034};
    g_assert_true(calibration_write(calibration, path, NULL));
    g_free(RUN(0, "calibrate", "report", path, "-o", html));
    g_assert_true(g_file_get_contents(html, &doubtful, NULL, NULL));
    assert_has(doubtful, "Calibrated: 4 of 4. To be looked at:");
    assert_has(doubtful,
               "<li>lights: more sights were left out (300) than used, of 7 pictures</li>");
    assert_has(doubtful, "<li>camera cam60 is 3.4 % off linear: switch off its gamma</li>");
    assert_has(doubtful, "<p>300 sights; the first are</p>");
    assert_has(doubtful,
               "<li>5.exr: ball 1 shows no lamp</li>\n</ul>\n<p>mesorig calibrate show --all");
    g_assert_null(strstr(doubtful, "<li>6.exr"));
    g_autofree char *shown = RUN(0, "calibrate", "show", path);
    assert_has(shown, "7 pictures, 300 sights left out");
    assert_has(shown, "--all");
    g_assert_null(strstr(shown, "5.exr"));
    g_autofree char *all = RUN(0, "calibrate", "show", path, "--all");
    assert_has(all, "\nleft out of lamps and arc: 300.exr: ball 1 shows no lamp\n");
    /* Four of seven sweeps are most of them. Four photographs of laser lines that were left out are
     * fewer than seven others that were used. */
    for (int i = 0; i < 2; i++) {
        g_autofree char *page = NULL;
        struct calibration_part *laser = calibration_set_part(
            calibration, CALIBRATION_LASER,
            i == 0 ? "a test" : "its line on a board in photographs", 7, "abc", NULL);
        for (int k = 0; k < 4; k++)
            g_ptr_array_add(laser->rejected, g_strdup("blurred"));
        g_assert_true(calibration_write(calibration, path, NULL));
        g_free(RUN(0, "calibrate", "report", path, "-o", html));
        g_assert_true(g_file_get_contents(html, &page, NULL, NULL));
        g_assert_cmpint(strstr(page, "<li>laser: more sweeps were left out (4) than used") != NULL,
                        ==, i == 0);
    }
    g_free(RUN(2, "calibrate", "radiometry", "tile.session", "-o", path));
    g_autofree char *percent = RUN(2, "calibrate", "radiometry", "t", "-r", "96", "-o", path);
    assert_has(percent, "96 is out of range: 0.05 to 1.2; for 96 % write 0.96");
    g_unlink(html);
    g_unlink(path);
}

TEST(cameras_usage) {
    g_autofree char *calibration = in_folder("none.calibration");
    g_autofree char *session = in_folder("calibrated.session");
    g_autofree char *no_board = RUN(2, "calibrate", "cameras", session, "-o", calibration);
    assert_has(no_board, "--board");
    g_autofree char *bad =
        RUN(2, "calibrate", "cameras", session, "-o", calibration, "--board", "8x8,square=9");
    assert_has(bad, "chessboard looks the same upside down");
    /* A session of something else, with too few angles. */
    g_autofree char *none = RUN(1, "calibrate", "cameras", session, "-o", calibration, "--board",
                                "8x8,square=9,marker=6.75");
    assert_has(none, "cannot be found from 2 angle(s)");
    g_autofree char *empty = RUN(1, "calibrate", "cameras", "--images", folder, "-o", calibration,
                                 "--board", "8x8,square=9,marker=6.75");
    assert_has(empty, "there is no .jpg, .png, .tif, .bmp, .pgm");
    g_assert_false(g_file_test(calibration, G_FILE_TEST_EXISTS));
}

TEST(board) {
    g_autofree char *png = in_folder("board.png");
    g_autofree char *calibration = in_folder("board.calibration");
    g_autofree char *told = RUN(0, "board", png, "--board", "8x8,square=9,marker=6.75", "--json");
    assert_has(told, "\"corners\": 49");
    g_autofree char *images = RUN(1, "calibrate", "cameras", "--images", folder, "-o", calibration,
                                  "--board", "8x8,square=9,marker=6.75");
    assert_has(images, "in 1 of 1 photographs, and at least 3 such photographs are needed");
    g_unlink(png);
    g_free(RUN(2, "board", png));
    g_free(RUN(1, "board", "/nowhere/board.svg", "--board", "8x8,square=9,marker=6.75"));
}

/* Which photographs are used must not depend on the order of a folder. */
TEST(too_many_photographs) {
    g_autofree char *many = in_folder("many"), *calibration = in_folder("many.calibration");
    g_assert_cmpint(g_mkdir(many, 0700), ==, 0);
    for (int i = 0; i < 1001; i++) {
        g_autofree char *path = g_strdup_printf("%s/%04d.png", many, i);
        g_assert_true(g_file_set_contents_full(path, "", 0, G_FILE_SET_CONTENTS_NONE, 0600, NULL));
    }
    g_autofree char *said = RUN(1, "calibrate", "laser", "--images", many, "-c", "none", "--board",
                                "8x8,square=9,marker=6.75", "-o", calibration);
    assert_has(said, "1001 photographs in that folder, but at most 1000 can be used");
    for (int i = 0; i < 1001; i++) {
        g_autofree char *path = g_strdup_printf("%s/%04d.png", many, i);
        g_unlink(path);
    }
    g_rmdir(many);
}

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}
