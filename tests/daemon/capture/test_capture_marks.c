/* Captures with white fiducials next to the sample, in a calibrated rig: the output of the lamps
 * that they show is stored, and if the rig has moved since its calibration, the session pauses
 * once. The truth is that of the world: the positions of its fiducials and cameras, and the output
 * of its lamps. */
#include <math.h>
#include <string.h>

#include "calibration/calibration.h"
#include "lib/capture_run.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"
#include "session/outputs.h"

#define N_MARKS    4
#define MARK_AT_MM 33 /* from the axis; the sample ends at 25 */

struct scene {
    double turned_deg;       /* all fiducials of the world, counter-clockwise */
    const char *albedo;      /* theirs; NULL: 0.9, as in the rig file */
    const char *camera_line; /* of the world's cam60; NULL: as in the rig file */
    const char *lamp_line;   /* of the world's lamp60; NULL: the same */
    gboolean placed, lit;    /* cameras are calibrated; so are responses and lamps */
};

static void write_marks(const struct run *run, const struct scene *scene) {
    for (int i = 0; i < N_MARKS; i++) {
        const double nominal_rad = i * G_PI / 2;
        const double rad = nominal_rad + scene->turned_deg * G_PI / 180;
        g_autofree char *in_rig =
            g_strdup_printf("[mark m%d]\nx_mm = %.9f\ny_mm = %.9f\nz_mm = 1\n"
                            "radius_mm = 3\nreflectance = 0.9\n",
                            i, MARK_AT_MM * cos(nominal_rad), MARK_AT_MM * sin(nominal_rad));
        g_autofree char *in_world = g_strdup_printf(
            "[mark m%d]\nx_mm = %.9f\ny_mm = %.9f\nz_mm = 1\nradius_mm = 3\nalbedo = %s\n", i,
            MARK_AT_MM * cos(rad), MARK_AT_MM * sin(rad), scene->albedo ? scene->albedo : "0.9");
        text_file_append(run->directory, "rig.conf", in_rig);
        text_file_append(run->directory, "world.conf", in_world);
    }
}

/* Of the rig as its file describes it. */
static void write_calibration(const struct run *run, const struct scene *scene) {
    struct rig rig;
    g_autofree char *conf = g_build_filename(run->directory, "rig.conf", NULL);
    g_autofree char *path = g_build_filename(run->directory, "rig.calibration", NULL);
    ok(devices_read_geometry(conf, &rig, ERR));
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    if (scene->placed)
        calibration_set_part(calibration, CALIBRATION_CAMERAS, "a test", 1, "", NULL);
    for (int i = 0; i < rig.n_cameras && scene->lit; i++) {
        calibration->camera_radiometry[i].known = TRUE;
        for (int k = 0; k < 3; k++)
            calibration->camera_radiometry[i].colour[k] = 1;
    }
    for (int i = 0; i < rig.n_lamps && scene->lit; i++) {
        calibration->lamp_radiometry[i].known = TRUE;
        for (int k = 0; k < 3; k++)
            calibration->lamp_radiometry[i].colour[k] = 1;
    }
    if (scene->lit)
        calibration_set_part(calibration, CALIBRATION_RADIOMETRY, "a test", 1, "", NULL);
    ok(calibration_write(calibration, path, ERR));
}

/* Pictures in which a fiducial of 3 mm has a radius of 5 pixels. */
static struct run *new_run(const struct scene *scene) {
    static const char *const cameras[] = {"[camera cam30]", "[camera cam60]"};
    struct change changes[12] = {{"[rig]", "calibration = rig.calibration"}, {"[lasers]", NULL}};
    int n = 2;
    for (int c = 0; c < 2; c++) {
        changes[n++] = (struct change){cameras[c], "width = 160"};
        changes[n++] = (struct change){cameras[c], "height = 160"};
        changes[n++] = (struct change){cameras[c], "focal_px = 1200"};
    }
    struct run *run = run_new(changes);
    devices_close(run->devices);
    if (scene->camera_line)
        changes[n++] = (struct change){cameras[1], scene->camera_line};
    if (scene->lamp_line)
        changes[n++] = (struct change){"[lamp lamp60]", scene->lamp_line};
    small_rig_write(run->directory, "world.conf", changes);
    write_marks(run, scene);
    write_calibration(run, scene);
    run_open_devices(run);
    return run;
}

static gboolean was_told(const struct run *run, const char *what) {
    return strstr(run->told->str, what) != NULL;
}

static char *value_of(const struct run *run, const char *key) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_assert_no_error(error);
    return session_value(session, key);
}

/* Nothing has moved: the first check says so, and each shot's output is that of its lamp. */
TEST(in_place) {
    static const struct scene scene = {.lamp_line = "intensity = 44", .placed = TRUE, .lit = TRUE};
    struct run *run = new_run(&scene);
    run_start(run);
    run_to_end(run);
    g_test_message("%s", run->told->str);
    g_assert_true(was_told(run, "info fiducials: fiducials were seen"));
    g_assert_false(was_told(run, "moved"));
    run_check_whole(run->session);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_assert_no_error(error);
    struct outputs *outputs = ok(outputs_load(session, shots, ERR));
    int n = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP) {
            g_assert_cmpfloat(outputs_error(outputs, shot->id), ==, 0);
            continue;
        }
        const double is = outputs_of(outputs, shot->id), true_output = shot->device ? 1.1 : 1;
        g_test_message("shot %d: %.4f of %.4f", (int)shot->id, is, true_output);
        g_assert_cmpfloat(fabs(is / true_output - 1), <, 0.02);
        g_assert_cmpfloat(outputs_error(outputs, shot->id), >, 0);
        n++;
    }
    g_assert_cmpint(n, >, 0);
    outputs_free(outputs);
    g_autofree char *accepted = value_of(run, "accepted_moves");
    g_assert_null(accepted);
    run_free(run);
}

/* The first shot warns, and the second one pauses the session. An operator who continues accepts
 * the state, also after the session was closed and resumed. */
static void moved(const struct scene *scene, const char *what, const char *accepted_text) {
    struct run *run = new_run(scene);
    run_start(run);
    run_to_pause(run, "Something has moved since the rig was calibrated: ");
    g_test_message("%s", run->told->str);
    g_assert_nonnull(strstr(run_status(run).reason, what));
    g_assert_nonnull(strstr(run_status(run).reason, "The last 2 shots may be affected"));
    g_assert_true(was_told(run, "warning fiducials: something may have moved"));
    g_assert_cmpint(run_status(run).fault, ==, CAPTURE_FAULT_RIG);
    g_assert_cmpint(run_status(run).shots_done, >=, 1);
    run_check_safe(run);
    run_continue(run);
    run_until(run, run_status(run).frames + 4);
    g_assert_cmpint(run_status(run).state, <, CAPTURE_PAUSED);
    g_autofree char *accepted = value_of(run, "accepted_moves");
    g_assert_cmpstr(accepted, ==, accepted_text);
    capture_abort(run->capture);
    run_resume(run);
    run_to_end(run);
    run_check_whole(run->session);
    run_free(run);
}

TEST(camera) {
    static const struct scene scene = {.camera_line = "phi_deg = 0.5", .placed = TRUE};
    moved(&scene, "camera cam60 is turned by", "cameras 1");
}

TEST(turntable) {
    static const struct scene scene = {.turned_deg = 0.5, .placed = TRUE};
    moved(&scene, "the turntable has slipped by ", "turntable");
}

/* One that the rig file alone describes is not held against it. Without radiometry nothing is said
 * of lamps. */
TEST(uncalibrated) {
    static const struct scene scenes[] = {
        {.camera_line = "phi_deg = 0.5", .lit = TRUE},
        {.camera_line = "phi_deg = 0.5"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(scenes); i++) {
        struct run *run = new_run(&scenes[i]);
        run_start(run);
        run_to_end(run);
        g_assert_false(was_told(run, "fiducials: "));
        g_autofree char *output = value_of(run, "lamp_output/2/cam30");
        g_assert_cmpint(output != NULL, ==, scenes[i].lit);
        run_free(run);
    }
}

/* Fiducials as dark as their surround are reported once, and do not stop the session. */
TEST(unseen) {
    static const struct scene scene = {.albedo = "0.04", .placed = TRUE, .lit = TRUE};
    struct run *run = new_run(&scene);
    run_start(run);
    run_to_end(run);
    const char *told = strstr(run->told->str, "warning fiducials: no camera sees a mark");
    g_assert_nonnull(told);
    g_assert_null(strstr(strchr(told, '\n'), "no camera sees a mark"));
    run_check_whole(run->session);
    run_free(run);
}

TESTS_RUN_BY(run_tests);
