/* From a white tile to reflectances of a grey scale, through sessions; and what marks notice. */
#include "capture/capture_marks.h"
#include "lib/grey_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "session/outputs.h"

#include <sqlite3.h>

TEST(tile) {
    struct grey_chi2 chi2 = {0};
    for (int seed = 1; seed <= 3; seed++) {
        g_autofree char *folder = grey_folder();
        g_autofree char *path = g_build_filename(folder, "calibration.conf", NULL);
        struct tile_result result;
        grey_calibrate(folder, seed, &result);
        g_assert_cmpint(result.marks, ==, 4);
        g_assert_cmpint(result.transfers, ==, 3);
        g_assert_cmpfloat(result.quality, >, 0.8);
        g_assert_cmpfloat(result.quality, <, 1.25);
        g_assert_cmpfloat(result.drift, >, 0.005);
        g_autoptr(Calibration) found = calibration_read(path, NULL);
        struct grey_chi2 own = {0};
        grey_compare(found, &own);
        grey_compare(found, &chi2);
        g_test_message("seed %d: %d pictures, residual %.4f, quality %.3f, chi-square %.2f of %d",
                       seed, result.pictures, result.residual, result.quality, own.sum / own.n,
                       own.n);
        radiometry_rig_remove(folder);
    }
    g_assert_cmpfloat(chi2.sum / chi2.n, >, 0.7);
    g_assert_cmpfloat(chi2.sum / chi2.n, <, 1.4);
}

/* The session of a tile again, with one thing wrong: what tile_session() says. undo: of sql; NULL:
 * the same again. */
static char *tile_refused(const char *path, double reflectance, const char *sql, const char *undo) {
    g_autoptr(GError) error = NULL;
    g_autofree char *db_path = g_build_filename(path, "session.db", NULL);
    struct tile_options options = {.reflectance = {reflectance, reflectance, reflectance}};
    struct tile_result result;
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(db_path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, sql, NULL, NULL, NULL), ==, SQLITE_OK);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autoptr(Calibration) calibration = calibration_from_text(text, path, &error);
    const struct rig before = calibration->rig;
    g_assert_false(tile_session(session, calibration, &options, &result, &error));
    g_assert_error(error, RADIOMETRY_ERROR, RADIOMETRY_ERROR_MISFIT);
    g_assert_cmpmem(&calibration->rig, sizeof before, &before, sizeof before);
    g_assert_cmpint(sqlite3_exec(db, undo ? undo : sql, NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
    g_test_message("%s", error->message);
    return g_strdup(error->message);
}

/* All pixels that a camera's raw exposures have, as a gamma would show them. */
static void put_gamma(const char *folder) {
    g_autoptr(GDir) names = g_dir_open(folder, 0, NULL);
    const char *name;
    while ((name = g_dir_read_name(names))) {
        g_autofree char *raw = g_build_filename(folder, name, "0000.exr", NULL);
        for (int k = 0; g_str_has_suffix(name, "_cam1") && g_file_test(raw, G_FILE_TEST_EXISTS);) {
            g_autoptr(ExrFile) file = exr_read(raw, NULL);
            struct exr_part *part = exr_file_part(file, "frame");
            float *y = exr_part_plane(part, "Y");
            for (int i = 0; i < part->width * part->height; i++)
                y[i] = (float)(4095 * pow((double)y[i] / 4095, 0.9));
            g_assert_true(exr_write(raw, file, EXR_NONE, FALSE, NULL));
            g_free(raw);
            raw = g_strdup_printf("%s/%s/%04d.exr", folder, name, ++k);
        }
    }
}

#define SWAP(a, b)                                                                                 \
    "UPDATE shot SET device = CASE device WHEN " #a " THEN " #b " WHEN " #b " THEN " #a            \
    " ELSE device END WHERE kind = 'lamp'"
#define RADIANS(what) "UPDATE shot SET " what " = " what " * 0.017453292519943295"
#define DEGREES(what) "UPDATE shot SET " what " = " what " / 0.017453292519943295"

TEST(wrong_tile) {
    static const struct {
        const char *sql, *undo, *says;
    } wrong[] = {
        {"UPDATE shot SET turntable_deg = -turntable_deg", NULL,
         "the turntable turns the wrong way"},
        {"UPDATE shot SET arc_deg = -arc_deg", NULL,
         "the sign of steps_per_deg or units_per_deg of [axis arc]"},
        {RADIANS("turntable_deg"), DEGREES("turntable_deg"),
         "the turntable's angles are in radians"},
        {RADIANS("arc_deg"), DEGREES("arc_deg"), "the arc's angles are in radians"},
        {SWAP(0, 1), NULL, "lamps lamp0 and lamp1 are exchanged"},
        {SWAP(0, 2), NULL, "lamps lamp0 and lamp2 are exchanged"},
        {SWAP(1, 2), NULL, "Exchange the indexes of [lamp lamp1] and [lamp lamp2]"},
    };
    g_autofree char *folder = grey_folder(), *path = g_build_filename(folder, "tile.session", NULL);
    g_autofree char *raw = g_build_filename(path, "frames", NULL);
    g_autofree char *found = g_build_filename(folder, "found.conf", NULL);
    struct tile_result result;
    grey_calibrate(folder, 1, &result);
    /* A grey tile of 0.5 said to be 0.96, which is as much too much as 1.84 for this one. */
    g_autofree char *dark = tile_refused(path, 0.96 * 0.96 / 0.5, "SELECT 1", NULL);
    assert_has(dark, "The tile is darker than --reflectance says");
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_autofree char *told = tile_refused(path, 0.96, wrong[i].sql, wrong[i].undo);
        assert_has(told, wrong[i].says);
    }
    g_autofree char *metres =
        process_mesorig(2, "calibrate radiometry %s -r 0.96 --tile 0.056x0.056 -o %s", path, found);
    assert_has(metres, "width and height of the tile in mm");
    put_gamma(raw);
    g_autofree char *gamma =
        process_mesorig(0, "calibrate radiometry %s -r 0.96 -o %s", path, found);
    assert_has(gamma, "camera cam1 is not linear");
    g_assert_null(strstr(gamma, "camera cam0 is not linear"));
    radiometry_rig_remove(folder);
}

TEST(grey_scale) {
    for (int seed = 1; seed <= 2; seed++)
        g_assert_cmpfloat(grey_error(seed, TRUE), <, 0.005);
}

static void expect(const char *world_keys, const char *turntable_keys, enum capture_state expected,
                   const char *says, const char * not ) {
    enum capture_state state;
    g_autofree char *told = grey_pause(1, world_keys, turntable_keys, &state);
    g_assert_cmpint(state, ==, expected);
    g_assert_nonnull(strstr(told, says));
    g_assert_true(!not || !strstr(told, not ));
}

TEST(quick_check) {
    expect(NULL, "", CAPTURE_DONE, "fiducials were seen", "moved since");
    expect("turn_deg=0;0.1;0", "", CAPTURE_PAUSED, "camera cam1 is turned by 0.1", "cam0");
    expect("turn_deg=-0.1;0;0", "", CAPTURE_PAUSED, "camera cam1 is turned by 0.", "cam2");
    expect(NULL, "fault_slip_deg=0.1\n", CAPTURE_PAUSED, "turntable has slipped by +0.", "cam");
    expect(NULL, "fault_slip_deg=-0.2\nfault_slip_at=2\n", CAPTURE_PAUSED,
           "turntable has slipped by -0.", "cam");
}

/* Four marks in each camera's picture, cam1's 3 pixels off if it is turned. */
static GArray *marks_of_shot(gboolean turned) {
    GArray *marks = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    for (int i = 0; i < 8; i++) {
        struct fiducial_seen seen = {.camera = i / 4,
                                     .fiducial = i % 4,
                                     .error_px = 0.01,
                                     .output_error = INFINITY,
                                     .expected_x_px = 30,
                                     .expected_y_px = 40};
        seen.x_px = seen.expected_x_px + (turned && seen.camera == 1 ? 3 : 0);
        seen.y_px = seen.expected_y_px;
        g_array_append_val(marks, seen);
    }
    return marks;
}

static char *check_shot(struct capture_marks *marks, const struct capture_session *session,
                        gboolean turned) {
    const struct session_shot shot = {.id = 1, .kind = SHOT_LAMP};
    g_autoptr(GArray) seen = marks_of_shot(turned);
    return ok(capture_marks_check(marks, session, &shot, seen, ERR));
}

/* A light may make fiducials look displaced. A single shot must not pause a capture at night. */
TEST(quick_check_asks_twice) {
    g_autofree char *folder = grey_folder(), *path = g_build_filename(folder, "few.session", NULL);
    g_autofree char *calibration_path = g_build_filename(folder, "calibration.conf", NULL);
    grey_truth(folder, "radiometry", 1);
    grey_write(folder, 1, "");
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "few", NULL, NULL, NULL), ==,
                    CAPTURE_DONE);
    g_autoptr(Clock) clock = clock_new_virtual();
    struct devices devices = {.clock = clock};
    struct capture_session session = {.devices = &devices,
                                      .store = session_open(path, SESSION_PRODUCTS, NULL),
                                      .calibration = calibration_read(calibration_path, NULL),
                                      .clock = {.clock = clock, .since_us = -1}};
    struct capture_marks marks = {0};
    static const gboolean shots[] = {FALSE, TRUE, FALSE, FALSE, TRUE, TRUE};
    for (gsize i = 0; i < G_N_ELEMENTS(shots); i++) {
        if (i == 2) /* what was seen in the window would still show */
            g_queue_clear_full(marks.window, (GDestroyNotify)g_array_unref);
        g_autofree char *told = check_shot(&marks, &session, shots[i]);
        g_assert_cmpint(told != NULL, ==, i == G_N_ELEMENTS(shots) - 1);
        g_assert_true(!told || strstr(told, "camera cam1 is turned by"));
    }
    capture_marks_forget(&marks);
    session_close(session.store);
    calibration_free(session.calibration);
    radiometry_rig_remove(folder);
}

/* Old calibrations are warned of, other rigs' and damaged ones refused. */
TEST(policy) {
    g_autofree char *folder = grey_folder();
    g_autofree char *path = g_build_filename(folder, "calibration.conf", NULL), *text = NULL;
    g_autoptr(GString) told = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    grey_write(folder, 1, "");
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "none", told, NULL, &error), ==,
                    CAPTURE_DONE);
    g_assert_nonnull(strstr(told->str, "does not exist yet"));
    grey_truth(folder, "radiometry", 40);
    g_string_truncate(told, 0);
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "old", told, NULL, &error), ==,
                    CAPTURE_DONE);
    g_assert_no_error(error);
    g_assert_nonnull(strstr(told->str, "calibration of cameras"));
    g_assert_nonnull(strstr(told->str, "40 days old"));
    grey_truth(folder, "another", 1);
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "other", told, NULL, &error), ==,
                    CAPTURE_ABORTED);
    g_assert_error(error, RIG_ERROR, RIG_ERROR_VALUE);
    g_assert_nonnull(strstr(error->message, "another"));
    g_clear_error(&error);
    grey_truth(folder, "radiometry", 1);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    text[strlen(text) / 2] = '\0';
    radiometry_rig_write(folder, "calibration.conf", text);
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "cut", told, NULL, &error), ==,
                    CAPTURE_ABORTED);
    g_assert_nonnull(strstr(error->message, "calibration.conf"));
    g_autofree char *session = g_build_filename(folder, "cut.session", NULL);
    g_assert_false(g_file_test(session, G_FILE_TEST_EXISTS));
    radiometry_rig_remove(folder);
}

/* Shots in which no mark was seen have what their lamp's neighbours have; nonsense is refused. */
TEST(lamp_outputs) {
    g_autofree char *folder = grey_folder();
    g_autofree char *path = g_build_filename(folder, "few.session", NULL);
    g_autoptr(GError) error = NULL;
    grey_write(folder, 1, "");
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_FEW_CONF, "few", NULL, NULL, &error), ==,
                    CAPTURE_DONE);
    g_autoptr(Session) session = session_open(path, SESSION_PRODUCTS, &error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    int of_lamp[16], n = 0;
    for (guint i = 0; i < shots->len && n < 16; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_LAMP && shot->device == 0)
            of_lamp[n++] = (int)shot->id;
    }
    g_assert_cmpint(n, >=, 3);
    struct outputs *outputs = outputs_load(session, shots, &error);
    g_assert_cmpfloat(outputs_of(outputs, of_lamp[0]), ==, 1);
    outputs_free(outputs);
    g_assert_true(outputs_store(session, of_lamp[0], "cam0", 1.02, 0.001, &error));
    g_assert_true(outputs_store(session, of_lamp[0], "cam1", 1.04, 0.001, &error));
    g_assert_true(outputs_store(session, of_lamp[2], "cam0", 0.97, 0.001, &error));
    outputs = outputs_load(session, shots, &error);
    for (guint i = 1; i <= shots->len; i++)
        g_assert_cmpint(outputs_error(outputs, i) > 0, ==,
                        (int)i == of_lamp[0] || (int)i == of_lamp[2]);
    g_assert_cmpfloat_with_epsilon(outputs_of(outputs, of_lamp[0]), 1.03, 1e-9);
    double part = (double)(of_lamp[1] - of_lamp[0]) / (of_lamp[2] - of_lamp[0]);
    g_assert_cmpfloat_with_epsilon(outputs_of(outputs, of_lamp[1]), 1.03 - 0.06 * part, 1e-9);
    g_assert_cmpfloat_with_epsilon(outputs_of(outputs, of_lamp[n - 1]), 0.97, 1e-9);
    outputs_free(outputs);
    static const char *const wrong[][2] = {{"lamp_output/1/cam0", "nan 0.1"},
                                           {"lamp_output/1/cam0", "1.0"},
                                           {"lamp_output/1/cam0", "-1 0.1"},
                                           {"lamp_output/9999/cam0", "1 0.1"},
                                           {"lamp_output/x", "1 0.1"}};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_assert_true(session_set_value(session, wrong[i][0], wrong[i][1], NULL));
        g_assert_null(outputs_load(session, shots, &error));
        g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
        g_clear_error(&error);
        g_assert_true(session_set_value(session, wrong[i][0], NULL, NULL));
    }
    g_clear_pointer(&session, session_close);
    radiometry_rig_remove(folder);
}

AFTER_TESTS {
    world_fixture_clean();
}
