/* The demo's whole chain on a part of its rig: two cameras, lamps and lasers are calibrated from
 * pictures of targets by etc/demo/calibrate, a session is captured with what was found and
 * processed with and without it; all of it compared with the simulated truth. */
#include "demo_calibration.h"
#include "exr/exr.h"
#include "lib/demo_part.h"
#include "lib/floats.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "rig/devices.h"
#include "session/session.h"
#include "world/truth.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEMO    SOURCE_DIR "/etc/demo/"
#define MESORIG BUILD_DIR "/bin/mesorig"
#define TEXELS  16
#define VIEWS   4
#define LIGHTS  4

static void copy(const char *name) {
    g_autofree char *from = g_build_filename(DEMO, name, NULL), *to = in_folder(name), *text = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(from, &text, &length, NULL));
    g_assert_true(g_file_set_contents(to, text, (gssize)length, NULL));
}

static void write_files(void) {
    demo_part_write(folder);
    copy("calibrate");
    copy("poles.conf");
    demo_part_write_targets(folder);
    demo_part_write_plate(folder, "plate.conf", 1);
    demo_part_write_session(folder, "session.conf",
                            "width_mm=50\nheight_mm=50\ntexels=16\nreference_mm=2.2\ndepth_mm=2.2",
                            "30:2; 60:2", "30:2; 60:2", "30:3; 60:3",
                            "exposures_us=4000;16000\nsweep_steps=64\nlaser_threshold_dn=12");
}

static void run(const char *const *argv) {
    g_free(process_text(0, argv));
}

#define RUN(...) run((const char *const[]){__VA_ARGS__, NULL})

/* Of all parts. */
static void check_page(const char *path) {
    static const char *const headings[] = {"Drift of the lamps", "Cameras", "Lamps and arc",
                                           "Laser sheets", "Light"};
    g_autofree char *page = NULL;
    g_assert_true(g_file_get_contents(path, &page, NULL, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(headings); i++) {
        g_autofree char *heading = g_strdup_printf("<h2>%s</h2>", headings[i]);
        g_assert_nonnull(strstr(page, heading));
    }
    g_assert_null(strstr(page, "nan"));
}

/* Returns the number of marks on a page of --found. All of them must lie in their pictures, and the
 * places that the calibration predicts must be near. */
static int check_found(const char *name) {
    g_autofree char *file = g_strdup_printf("targets/found-%s.html", name);
    g_autofree char *path = in_folder(file), *page = NULL;
    int n = 0, width = 0, height = 0;
    double x, y, px;
    g_assert_true(g_file_get_contents(path, &page, NULL, NULL));
    for (const char *at = page; (at = strchr(at, '<')); at++) {
        if (sscanf(at, "<svg viewBox=\"0 0 %d %d\"", &width, &height) == 2)
            continue;
        if (sscanf(at, "<circle cx=\"%lf\" cy=\"%lf\"", &x, &y) == 2) {
            g_assert_true(x > 0 && x < width && y > 0 && y < height);
            n++;
        } else if (sscanf(at, "<br>%*d found, %lf px RMS", &px) == 1) {
            g_assert_cmpfloat(px, >, 0);
            g_assert_cmpfloat(px, <, 0.5);
        }
    }
    return n;
}

/* Compares the first mark of each picture of the tile, a corner of the tile, with the truth. */
static void check_outline(World *world) {
    g_autofree char *path = in_folder("targets/found-radiometry.html"), *page = NULL;
    const double corner_mm[3] = {-30, -30, 2.2};
    int n = 0, theta_deg;
    double turntable_deg, x, y, at_mm[3], px[2];
    g_assert_true(g_file_get_contents(path, &page, NULL, NULL));
    for (const char *at = page; (at = strstr(at, "aria-label=\"cam")); at++) {
        g_assert_cmpint(sscanf(at, "aria-label=\"cam%d under lamp%*d, turntable at %lf", &theta_deg,
                               &turntable_deg),
                        ==, 2);
        const char *mark = strstr(at, "<circle");
        g_assert_cmpint(sscanf(mark, "<circle cx=\"%lf\" cy=\"%lf\"", &x, &y), ==, 2);
        truth_to_rig(world, turntable_deg, corner_mm, at_mm);
        truth_project(world, theta_deg == 30 ? 0 : 1, at_mm, px);
        g_assert_cmpfloat(hypot(x - 0.5 - px[0], y - 0.5 - px[1]), <, 0.3);
        n++;
    }
    g_assert_cmpint(n, ==, 16);
}

TEST(calibrate) {
    g_autofree char *script = in_folder("calibrate"), *path = in_folder("rig.calibration"),
                    *targets = in_folder("targets"), *world_path = in_folder("world.conf"),
                    *page = in_folder("calibration.html");
    g_autoptr(GError) error = NULL;
    RUN("/bin/sh", script, BUILD_DIR, path, targets);
    RUN(MESORIG, "calibrate", "report", path, "-o", page);
    check_page(page);
    g_autoptr(Calibration) found = calibration_read(path, &error);
    g_assert_no_error(error);
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        g_assert_true(found->parts[i].done);
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(check_found("cameras"), >, 500);
    g_assert_cmpint(check_found("lights"), >, 100);
    g_assert_cmpint(check_found("laser"), >, 1000);
    g_assert_cmpint(check_found("radiometry"), ==, 16 * 64);
    check_outline(world);
    static const struct demo_step steps[] = {{0, 40, -2}, {0, 200, 0}, {1, 100, 1}, {1, 300, 3}};
    struct demo_errors errors;
    demo_errors_of(world, found, steps, G_N_ELEMENTS(steps), &errors);
    g_test_message("cameras %.4f px, axis %.4f mm, lamps %.3f° %.2f %%, arc %.3f°, sheets %.3f° "
                   "%.3f mm, light %.2f %%",
                   errors.camera_px, errors.axis_mm, errors.lamp_deg, errors.lamp_pct,
                   errors.arc_zero_deg, errors.sheet_deg, errors.sheet_mm,
                   100 * errors.light_worst);
    g_assert_cmpfloat(errors.camera_px, <, 0.05);
    g_assert_cmpfloat(errors.axis_mm, <, 0.05);
    g_assert_cmpfloat(errors.lamp_deg, <, 0.3);
    g_assert_cmpfloat(errors.sheet_mm, <, 0.1);
    g_assert_cmpfloat(errors.light_worst, <, 0.03); /* lamps drift by 2 % up and down */
}

/* Of one view under one light, green. */
static void compare_btf(Session *session, World *world, const char *path, GArray *errors) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) shots = session_shots(session, &error),
                         views = session_views(session, &error);
    const struct truth_grid grid = {TEXELS, TEXELS, 50, 50, 2.2};
    g_autofree float *truth = g_new(float, TEXELS *TEXELS * 3);
    const struct session_direction *view = views->pdata[1];
    struct exr_part *part = ok(exr_read_part(path, "light_0001", ERR));
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP || shot->source != 1 ||
            !camera_set_has(shot->cameras, view->device) ||
            fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
            continue;
        truth_btf(world, view->device, shot->device, shot->turntable_deg, shot->arc_deg, &grid, 24,
                  truth);
        for (int t = 0; t < TEXELS * TEXELS; t++) {
            const float off = fabsf(exr_part_plane(part, "G")[t] / truth[3 * t + 1] - 1);
            g_array_append_val(errors, off);
        }
    }
    exr_part_free(part);
}

static float btf_error(const char *directory) {
    g_autofree char *world_path = in_folder("world.conf");
    g_autofree char *path = g_build_filename(directory, "products/btf/view_0001.exr", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(float));
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Session) session = session_open(directory, SESSION_READ, &error);
    g_assert_no_error(error);
    compare_btf(session, world, path, errors);
    g_assert_cmpint(errors->len, ==, TEXELS * TEXELS);
    g_array_sort(errors, floats_by_value);
    return g_array_index(errors, float, errors->len / 2);
}

/* With what was found, without it, and with it again. */
TEST(process) {
    g_autofree char *rig = in_folder("rig.conf"), *conf = in_folder("session.conf"),
                    *directory = in_folder("weave.session"),
                    *calibration = in_folder("rig.calibration");
    g_autofree char *product = g_build_filename(directory, "products/btf/view_0001.exr", NULL);
    g_autoptr(GError) error = NULL;
    RUN(MESORIG, "capture", rig, conf, "-o", directory, "-c", calibration);
    RUN(MESORIG, "process", directory);
    const float calibrated = btf_error(directory);
    g_autofree char *before = exr_sha256(product, NULL, &error);
    RUN(MESORIG, "process", directory, "-c", "nominal");
    const float nominal = btf_error(directory);
    RUN(MESORIG, "process", directory, "-c", calibration);
    g_autofree char *after = ok(exr_sha256(product, NULL, ERR));
    g_test_message("BTF: %.1f %% by the rig file, %.1f %% calibrated", (double)(100 * nominal),
                   (double)(100 * calibrated));
    g_assert_cmpfloat(calibrated, <, 0.5f * nominal);
    g_assert_cmpstr(before, ==, after);
}

/* One of another rig would be a plausible wrong answer. */
TEST(process_refuses) {
    g_autofree char *directory = in_folder("weave.session"), *path = in_folder("rig.calibration"),
                    *other = in_folder("other.calibration");
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_read(path, &error);
    g_assert_no_error(error);
    g_strlcpy(calibration->rig.id, "other", sizeof calibration->rig.id);
    g_assert_true(calibration_write(calibration, other, &error));
    const char *const argv[] = {MESORIG, "process", directory, "-c", other, NULL};
    g_autofree char *err = NULL;
    g_assert_cmpint(process_run(argv, NULL, &err), ==, 1);
    g_assert_nonnull(strstr(err, "a calibration of rig other, but this is rig demo"));
}

BEFORE_TESTS {
    folder_make();
    write_files();
}

AFTER_TESTS {
    folder_remove();
}
