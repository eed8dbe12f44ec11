/* Test shots before a long capture: each fault that would spoil the capture is reported after at
 * most five test shots, with a number and with advice, before anything is captured. A rig without
 * faults passes. */
#include <glib/gstdio.h>
#include <string.h>

#include "calibration/calibration.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"

/* 24 views under 24 lights. */
static const struct change many[] = {
    {"[views]", "rings = 30:12; 60:12"}, {"[lights]", "rings = 30:12; 60:12"}, {0}};

struct spoilt {
    struct change rig, world, session; /* head NULL: as it is */
    const char *told[3];
};

static struct operation *new_run(const struct spoilt *spoilt) {
    const struct change rig[] = {spoilt->rig, {0}}, world[] = {spoilt->world, {0}};
    const struct change session[] = {many[0], many[1], spoilt->session, {0}};
    struct operation *run = operator_new(rig);
    small_rig_write(run->directory, "world.conf", world);
    small_rig_write(run->directory, "session.conf", session);
    return run;
}

/* "… the check before the capture (5 test shots) gave …" */
static int shots_said(const struct operation *run) {
    const char *at = strstr(run->err, " test shots) gave ");
    g_assert_nonnull(at);
    while (at > run->err && at[-1] != '(')
        at--;
    return atoi(at);
}

TEST(spoilt) {
    static const struct spoilt all[] = {
        /* 20 times too long, and too short. */
        {.session = {"[capture]", "exposures_us = 80000; 320000"},
         .told = {"camera cam30's pixels are saturated at 80000 µs under lamp lamp30",
                  "camera cam60's pixels are saturated", "exposures_us, to about"}},
        {.session = {"[capture]", "exposures_us = 200; 800"},
         .told = {"camera cam30 reaches only", "at 800 µs", "exposures_us, to about"}},
        {.rig = {"[lamps bank]", "fault_dead = lamp60"},
         .told = {"lamp lamp60 changes no camera's picture"}},
        {.world = {"[camera cam60]", "response = 0.01"},
         .told = {"camera cam60 sees none of the 2 lamps that were tried, with exposures of up to "
                  "16000 µs"}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        struct operation *run = new_run(&all[i]);
        operator_captures(run, 1);
        g_test_message("%s", run->err);
        for (gsize k = 0; k < G_N_ELEMENTS(all[i].told) && all[i].told[k]; k++)
            assert_has(run->err, all[i].told[k]);
        assert_has(run->err, "--yes begins it nevertheless");
        g_assert_cmpint(shots_said(run), >=, 2);
        g_assert_cmpint(shots_said(run), <=, 5);
        assert_has(run->err, "are not calibrated");
        g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
        operator_free(run);
    }
}

/* What is suggested is good: neither too long nor too short. */
TEST(suggestion) {
    static const char *const wrong[] = {"exposures_us = 80000", "exposures_us = 400"};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        struct spoilt spoilt = {.session = {"[capture]", wrong[i]}};
        struct operation *run = new_run(&spoilt);
        operator_captures(run, 1);
        const double us = g_ascii_strtod(strstr(run->err, "to about ") + strlen("to about "), NULL);
        operator_free(run);
        g_autofree char *line = g_strdup_printf("exposures_us = %.0f", us);
        spoilt.session.line = line;
        run = new_run(&spoilt);
        operator_does(run, 0, "capture", run->rig, run->conf, "-o", run->session, "--yes", NULL);
        g_assert_null(strstr(run->err, "warning: camera"));
        operator_free(run);
    }
}

/* With --yes the command warns and continues. A short session has no test shots. */
TEST(yes) {
    const struct spoilt dead = {.world = {"[camera cam60]", "response = 0.01"}};
    struct operation *run = new_run(&dead);
    operator_does(run, 0, "capture", run->rig, run->conf, "-o", run->session, "--yes", NULL);
    assert_has(run->err, "mesorig: warning: camera cam60 sees none");
    operator_free(run);
    run = new_run(&dead);
    small_rig_write(run->directory, "session.conf", NULL);
    operator_captures(run, 0);
    g_assert_null(strstr(run->err, "warning: camera"));
    operator_free(run);
}

/* A calibration that is done, and true, or one that lacks the laser: the file's path. */
static char *calibrate(const struct operation *run, gboolean laser) {
    struct rig rig;
    char *path = g_build_filename(run->directory, "rig.calibration", NULL);
    ok(devices_read_geometry(run->rig, &rig, ERR));
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    for (int kind = 0; kind < CALIBRATION_PARTS; kind++)
        if (laser || kind != CALIBRATION_LASER)
            calibration_set_part(calibration, (enum calibration_kind)kind, "a test", 1, "", NULL);
    ok(calibration_write(calibration, path, ERR));
    return path;
}

/* The only mistake is that the directory already exists, which is reported after the test shots. */
static void try_calibrated(struct operation *run, gboolean laser) {
    g_autofree char *calibration = calibrate(run, laser);
    g_mkdir(run->session, 0777);
    operator_does(run, 1, "capture", run->rig, run->conf, "-o", run->session, "-c", calibration,
                  NULL);
    g_test_message("%s", run->err);
}

TEST(calibrated) {
    static const struct spoilt none = {0};
    struct operation *run = new_run(&none);
    operator_captures(run, 1); /* not calibrated at all: that alone is a reason to stop */
    assert_has(run->err, "not calibrated (cameras, lights, laser, radiometry)");
    g_assert_cmpint(shots_said(run), <=, 5);
    g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
    try_calibrated(run, FALSE);
    assert_has(run->err, "not calibrated (laser)");
    try_calibrated(run, TRUE);
    g_assert_null(strstr(run->err, "warning"));
    assert_has(run->err, "exists already");
    operator_free(run);
}

/* Six lamps. A dead lamp among the first five shots is reported there, and any other one at its own
 * shot. */
TEST(many_lamps) {
    static const char lamps[] = "20 35 45 70";
    for (int dead = 0; dead < 2; dead++) {
        struct spoilt spoilt = {
            .session = {"[lights]", "rings = 20:4; 30:4; 35:4; 45:4; 60:4; 70:4"}};
        struct operation *run = new_run(&spoilt);
        g_auto(GStrv) thetas = g_strsplit(lamps, " ", -1);
        for (int i = 0; thetas[i]; i++) {
            g_autofree char *in_rig =
                g_strdup_printf("[lamp lamp%s]\nbank = bank\nindex = %d\ntheta_deg = %s\n"
                                "distance_mm = 500\nexponent = 2\nintensity = 40\n",
                                thetas[i], 2 + i, thetas[i]);
            g_autofree char *in_world =
                g_strdup_printf("[lamp lamp%s]\ntheta_deg = %s\ndistance_mm = 500\n"
                                "intensity = 40\n",
                                thetas[i], thetas[i]);
            text_file_append(run->directory, "rig.conf", in_rig);
            text_file_append(run->directory, "world.conf", in_world);
        }
        g_autofree char *text = NULL;
        g_file_get_contents(run->rig, &text, NULL, NULL);
        const struct change change = {"[lamps bank]",
                                      dead ? "fault_dead = lamp70" : "fault_dead = lamp30"};
        g_autofree char *changed = small_rig_changed(text, &change);
        g_assert_true(g_file_set_contents(run->rig, changed, -1, NULL));
        try_calibrated(run, TRUE);
        assert_has(run->err, dead ? "lamp lamp70 changes no camera's picture"
                                  : "lamp lamp30 changes no camera's picture");
        assert_has(run->err, "gave 1 warning, so the capture was not begun");
        g_test_message("told after %d test shots", shots_said(run));
        if (dead) /* the dimmest */
            g_assert_cmpint(shots_said(run), <=, 5);
        else
            g_assert_cmpint(shots_said(run), ==, 7);
        operator_free(run);
    }
}

/* White fiducials next to the sample: where the calibration has them, or not. */
TEST(fiducials) {
    static const struct {
        const char *line, *told; /* of the world's cam60 */
        const char *albedo;
    } cases[] = {
        {"phi_deg = 0", NULL, "0.9"},
        {"phi_deg = 0.5", "something has moved since the rig was calibrated: camera cam60", "0.9"},
        {"phi_deg = 0", "no camera sees a fiducial", "0.04"}, /* as dark as what is around */
    };
    static const int places_mm[][2] = {{33, 0}, {0, 33}, {-33, 0}, {0, -33}};
    static const char *const cameras[] = {"[camera cam30]", "[camera cam60]"};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct operation *run = new_run(&(struct spoilt){0});
        struct change changes[8] = {0};
        int n = 0;
        for (int c = 0; c < 2; c++) {
            changes[n++] = (struct change){cameras[c], "width = 160"};
            changes[n++] = (struct change){cameras[c], "height = 160"};
            changes[n++] = (struct change){cameras[c], "focal_px = 1200"};
        }
        small_rig_write(run->directory, "rig.conf", changes);
        changes[n++] = (struct change){cameras[1], cases[i].line};
        small_rig_write(run->directory, "world.conf", changes);
        for (gsize k = 0; k < G_N_ELEMENTS(places_mm); k++) {
            g_autofree char *mark =
                g_strdup_printf("[mark m%d]\nx_mm = %d\ny_mm = %d\nz_mm = 1\nradius_mm = 3\n",
                                (int)k, places_mm[k][0], places_mm[k][1]);
            g_autofree char *in_rig = g_strconcat(mark, "reflectance = 0.9\n", NULL);
            g_autofree char *in_world = g_strconcat(mark, "albedo = ", cases[i].albedo, "\n", NULL);
            text_file_append(run->directory, "rig.conf", in_rig);
            text_file_append(run->directory, "world.conf", in_world);
        }
        try_calibrated(run, TRUE);
        if (cases[i].told) {
            assert_has(run->err, cases[i].told);
            g_assert_cmpint(shots_said(run), <=, 5);
        } else {
            g_assert_null(strstr(run->err, "warning"));
        }
        operator_free(run);
    }
}

TESTS_RUN_BY(operator_tests);
