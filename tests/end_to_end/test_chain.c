/* The demo's whole chain on a part of its rig: two cameras, lamps and lasers are calibrated from
 * pictures of targets by etc/demo/calibrate, a session is captured with what was found and
 * processed with and without it; all of it compared with the simulated truth. */
#include "demo_calibration.h"
#include "exr/exr.h"
#include "lib/floats.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "rig/devices.h"
#include "session/session.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEMO    SOURCE_DIR "/etc/demo/"
#define MESORIG BUILD_DIR "/bin/mesorig"
#define TEXELS  16
#define VIEWS   4
#define LIGHTS  4

/* Devices at 30° and 60° are left. */
static void write_part(const char *name) {
    static const char *const sections[] = {"camera cam%d", "lamp lamp%d", "laser laser%d",
                                           "axis sweep%d"};
    static const int others[] = {15, 45, 75};
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autofree char *from = g_build_filename(DEMO, name, NULL), *to = in_folder(name);
    ok(g_key_file_load_from_file(file, from, G_KEY_FILE_NONE, ERR));
    for (gsize s = 0; s < G_N_ELEMENTS(sections); s++)
        for (gsize i = 0; i < G_N_ELEMENTS(others); i++) {
            g_auto(GStrv) parts = g_strsplit(sections[s], "%d", 2);
            g_autofree char *group = g_strdup_printf("%s%d", parts[0], others[i]);
            g_key_file_remove_group(file, group, NULL);
        }
    if (g_key_file_has_group(file, "rig")) {
        g_key_file_set_value(file, "lamp lamp30", "index", "0");
        g_key_file_set_value(file, "lamp lamp60", "index", "1");
    } else {
        g_key_file_set_value(file, "world", "gather_rays", "0");
    }
    ok(g_key_file_save_to_file(file, to, ERR));
}

static void write_session(const char *name, const char *sample, const char *views,
                          const char *lights, const char *lasers, const char *capture) {
    g_autofree char *path = in_folder(name);
    g_autofree char *lights_text =
        lights ? g_strdup_printf("[lights]\nrings=%s\noffset_deg=40\n", lights) : g_strdup("");
    g_autofree char *lasers_text =
        lasers ? g_strdup_printf("[lasers]\nrings=%s\noffset_deg=20\n", lasers) : g_strdup("");
    g_autofree char *text = g_strdup_printf("[session]\nname=%s\n[sample]\n%s\n[views]\nrings=%s\n"
                                            "%s%s[capture]\non_blocked=skip\n%s\n",
                                            name, sample, views, lights_text, lasers_text, capture);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

static void copy(const char *name) {
    g_autofree char *from = g_build_filename(DEMO, name, NULL), *to = in_folder(name), *text = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(from, &text, &length, NULL));
    g_assert_true(g_file_set_contents(to, text, (gssize)length, NULL));
}

static void write_files(void) {
    write_part("rig.conf");
    write_part("world.conf");
    copy("calibrate");
    copy("poles.conf");
    write_session("board.conf", "width_mm=72\nheight_mm=72\ntexels=8\nreference_mm=3\ndepth_mm=3",
                  "30:9; 60:9", "30:1", NULL, "exposures_us=8000");
    write_session("lights.conf",
                  "width_mm=60\nheight_mm=60\ntexels=8\nreference_mm=20\ndepth_mm=20", "30:4; 60:4",
                  "30:2; 60:2", NULL, "exposures_us=2000;8000");
    write_session("plate.conf",
                  "width_mm=60\nheight_mm=60\ntexels=8\nreference_mm = 1\ndepth_mm = 1",
                  "30:1; 60:1", NULL, "30:3; 60:3",
                  "sweep_steps=64\nlaser_threshold_dn=12\nexposures_us=8000");
    write_session("tile.conf",
                  "width_mm=60\nheight_mm=60\ntexels=8\nreference_mm=2.2\ndepth_mm=2.2",
                  "30:2; 60:2", "30:2; 60:2", NULL,
                  "exposures_us=1000;1000;3000;3000;7000;7000\nkeep_exposures=yes");
    write_session("session.conf",
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
