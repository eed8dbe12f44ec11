/* Checks before a capture begins or continues: whether there is enough space, whether the rig is
 * that of the session, and which calibration is used. */
#include "capture/capture_check.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "calibration/calibration.h"
#include "capture/capture_calibration.h"
#include "exr/exr.h"
#include "lib/capture_run.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "plan/report.h"

TEST(disk) {
    struct run *run = run_new(NULL);
    g_autofree char *deep = g_build_filename(run->directory, "no", "such", "folder", NULL);
    g_autofree char *loop = g_build_filename(run->directory, "loop", NULL);
    g_autoptr(GError) error = NULL;
    g_assert_cmpuint(capture_free_bytes(deep), <, G_MAXUINT64);
    g_assert_cmpint(symlink("loop", loop), ==, 0);
    g_assert_cmpuint(capture_free_bytes(loop), ==, G_MAXUINT64); /* not known */
    g_assert_true(capture_check_disk(deep, 1, &error));
    g_assert_true(ok(capture_check_disk(loop, 1, ERR)));
    g_assert_false(capture_check_disk("/proc/small.session", 1, &error));
    assert_has(error->message, "it is not on a disk");
    g_clear_error(&error);
    g_assert_false(capture_check_disk(deep, G_MAXUINT64 / 4, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FULL);
    assert_has(error->message, deep);
    g_assert_true(capture_is_full(run->directory, error));
    g_autoptr(GError) picture = g_error_new_literal(EXR_ERROR, EXR_ERROR_FULL, "full");
    g_autoptr(GError) other = g_error_new_literal(EXR_ERROR, EXR_ERROR_IO, "broken");
    g_assert_true(capture_is_full(run->directory, picture));
    g_assert_false(capture_is_full(run->directory, other));
    run_free(run);
}

/* A session that is made, not begun; the caller's. */
static Session *create(struct run *run) {
    ok(capture_create(run->devices, &run->conf, run->session, ERR));
    Session *session = ok(session_open(run->session, SESSION_READ, ERR));
    return session;
}

TEST(rig) {
    static const struct {
        struct change changes[3];
        const char *words; /* NULL: it is the session's */
    } cases[] = {
        {{{0}}, NULL},
        {{{"[axis arc]", "speed_deg_s = 30"}, {0}}, NULL},
        {{{"[rig]", "id = large"}, {0}}, "was begun on rig small, but this is rig large"},
        {{{"[camera cam60]", "width = 64"}, {0}},
         "camera 2, counted from 1, was cam60 with 32 × 32 pixels when the session was begun and "
         "is cam60 with 64 × "
         "32"},
        {{{"[camera cam60]", "height = 64"}, {0}}, "with 32 × 64 now"},
        {{{"[camera cam30]", NULL}, {0}}, "camera 1, counted from 1, was cam30"},
        {{{"[camera cam60]", NULL}, {0}}, "needs a camera that rig small does not"},
        {{{"[lamp lamp60]", NULL}, {0}}, "needs a lamp that"},
        {{{"[laser laser60]", NULL}, {"[axis sweep60]", NULL}, {0}}, "needs a laser that"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct run *run = run_new(NULL);
        g_autoptr(Session) session = create(run);
        g_autoptr(GError) error = NULL;
        g_autoptr(GPtrArray) shots = session_shots(session, &error);
        g_assert_no_error(error);
        run_change_rig(run, cases[i].changes);
        const gboolean good = capture_check_rig(session, shots, run->devices, &error);
        g_assert_cmpint(good, ==, cases[i].words == NULL);
        if (!good)
            assert_has(error->message, cases[i].words);
        run_free(run);
    }
}

/* A rig file that was changed between pause and resume. */
TEST(options) {
    static const struct {
        struct change changes[3];
        const char *words; /* NULL: no warning */
    } cases[] = {
        {{{0}}, NULL},
        {{{"[axis arc]", "speed_deg_s = 30"}, {0}}, "[axis arc] speed_deg_s was"},
        {{{"[lamp lamp60]", NULL}, {0}}, "[lamp lamp60] is not there now"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct run *run = run_new(NULL);
        g_autoptr(Session) session = create(run);
        run_change_rig(run, cases[i].changes);
        g_autofree char *warning = capture_check_options(session, run->devices);
        g_assert_cmpint(warning != NULL, ==, cases[i].words != NULL);
        if (warning)
            assert_has(warning, cases[i].words);
        run_free(run);
    }
}

static void set_serial(const struct run *run, const char *camera, const char *serial) {
    g_autofree char *path = g_build_filename(run->directory, "world.conf", NULL);
    g_autofree char *text = NULL, *changed = NULL;
    g_autofree char *line = g_strdup_printf("serial = %s", serial);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    changed = small_rig_changed(text, &(struct change){camera, line});
    g_assert_true(g_file_set_contents(path, changed, -1, NULL));
}

static void reopen_with(struct run *run, const char *serial_30, const char *serial_60) {
    run_change_rig(run, NULL);
    devices_close(run->devices);
    set_serial(run, "[camera cam30]", serial_30);
    set_serial(run, "[camera cam60]", serial_60);
    run_open_devices(run);
}

/* Another device that answers to the same options. */
TEST(devices) {
    struct run *run = run_new(NULL);
    g_autoptr(GPtrArray) kept = g_ptr_array_new_with_free_func(g_free);
    reopen_with(run, "7", "8");
    run_start(run);
    run_until(run, 4);
    capture_pause(run->capture);
    run_until(run, 0);
    g_clear_pointer(&run->capture, capture_free);
    reopen_with(run, "7", "8");
    run_resume(run);
    g_assert_null(strstr(run->told->str, "Other devices"));
    g_clear_pointer(&run->capture, capture_free);
    /* Two cameras whose cables were exchanged: both are named. */
    reopen_with(run, "8", "7");
    run_resume(run);
    assert_has(run->told->str,
               "warning rig: Other devices answer than when the session was begun: camera cam30 "
               "was simulated camera, serial number 7 and is simulated camera, serial number 8; "
               "camera cam60 was simulated camera, serial number 8 and is ");
    run_to_end(run);
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, NULL);
    session_suspicions(session, kept);
    g_assert_cmpuint(kept->len, ==, 1);
    assert_has(kept->pdata[0], "Other devices answer");
    run_free(run);
}

/* Sentences about a session are kept once each. */
TEST(suspicions) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) all = g_ptr_array_new_with_free_func(g_free);
    Session *made = create(run);
    session_close(made);
    g_autoptr(Session) session = session_open(run->session, SESSION_PRODUCTS, &error);
    g_assert_no_error(error);
    for (int i = 0; i < 4; i++)
        g_assert_true(session_suspect(session, i % 2 ? "one" : "another", &error));
    session_suspicions(session, all);
    g_assert_cmpuint(all->len, ==, 2);
    g_assert_cmpstr(all->pdata[1], ==, "one");
    run_free(run);
}

static void write_calibration(const struct run *run, const char *path) {
    g_autoptr(Calibration) calibration = calibration_new(&run->devices->geometry);
    calibration_set_part(calibration, CALIBRATION_LASER, "a test", 1, "", NULL);
    ok(calibration_write(calibration, path, ERR));
}

static void replace_in(const char *path, const char *pattern, const char *with) {
    g_autofree char *text = NULL;
    g_autoptr(GRegex) regex = g_regex_new(pattern, G_REGEX_MULTILINE, 0, NULL);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_autofree char *changed = g_regex_replace(regex, text, -1, 0, with, 0, NULL);
    g_assert_cmpstr(changed, !=, text);
    g_assert_true(g_file_set_contents(path, changed, -1, NULL));
}

/* The number of warnings, the first of which has these words; or the error. */
static void read_calibration(const struct run *run, guint n_warnings, const char *words) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) warnings = NULL;
    g_autoptr(Calibration) calibration = capture_calibration(run->devices, &warnings, &error);
    if (!calibration) {
        assert_has(error->message, words);
        return;
    }
    g_assert_cmpuint(warnings->len, ==, n_warnings);
    if (n_warnings > 0)
        assert_has(warnings->pdata[0], words);
    else
        g_assert_null(words);
}

TEST(calibration) {
    static const struct change named[] = {{"[rig]", "calibration = rig.calibration"}, {0}};
    struct run *run = run_new(named);
    g_autofree char *path = g_build_filename(run->directory, "rig.calibration", NULL);
    g_autofree char *other = g_build_filename(run->directory, "other.calibration", NULL);
    g_autofree char *rig = g_build_filename(run->directory, "rig.conf", NULL);
    g_autoptr(GError) error = NULL;
    read_calibration(run, 1, "does not exist yet");
    write_calibration(run, path);
    read_calibration(run, 0, NULL);
    g_autofree char *line = capture_calibration_line(rig, NULL, &error);
    assert_has(line, path);
    g_assert_null(capture_calibration_line("/no/such/rig.conf", NULL, &error));
    g_assert_nonnull(error);
    g_clear_error(&error);

    g_autoptr(Session) session = create(run);
    g_assert_null(capture_check_calibration(session, run->devices));
    replace_in(path, "^date=.*$", "date=2001-02-03T04:05:06Z");
    read_calibration(run, 1, "days old; “mesorig calibrate laser” renews it");
    g_autofree char *changed = capture_check_calibration(session, run->devices);
    assert_has(changed, "is not the one with which the session was begun");
    write_calibration(run, other);
    replace_in(other, "^id=small$", "id=large");
    g_assert_null(capture_calibration_line(rig, other, &error));
    assert_has(error->message, other);
    g_assert_true(g_file_set_contents(path, "[camera", -1, NULL));
    read_calibration(run, 0, path);
    g_autofree char *broken = capture_check_calibration(session, run->devices);
    g_assert_nonnull(broken);
    run_free(run);

    run = run_new(NULL); /* its rig file names none */
    g_autofree char *plain = g_build_filename(run->directory, "rig.conf", NULL);
    read_calibration(run, 0, NULL);
    g_clear_error(&error);
    g_autofree char *none = ok(capture_calibration_line(plain, NULL, ERR));
    assert_has(none, "none: geometry and light are nominal");
    run_free(run);
}

TEST(duration) {
    static const double never_s[] = {NAN, INFINITY, -1, 1e10};
    static const struct {
        double seconds;
        const char *text;
    } cases[] = {{0, "0 s"},         {9.94, "9.9 s"},      {9.96, "10 s"},
                 {61, "1 min 01 s"}, {3660, "1 h 01 min"}, {2 * 86400 + 3 * 3600, "2 d 03 h"}};
    for (gsize i = 0; i < G_N_ELEMENTS(never_s); i++) {
        g_autofree char *text = report_duration(never_s[i]);
        g_assert_cmpstr(text, ==, "?");
    }
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *text = report_duration(cases[i].seconds);
        g_assert_cmpstr(text, ==, cases[i].text);
    }
}

TESTS_RUN_BY(run_tests);
