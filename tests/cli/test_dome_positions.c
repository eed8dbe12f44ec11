/* calibrate lights --images --dome-radius: positions of lamps in a dome that is a few sample widths
 * wide, from one glossy ball in the simulated world. The ball lies next to the sample. The list is
 * then the positions of a bank in a rig file. */
#include "geometry/rig.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define MESORIG   BUILD_DIR "/bin/mesorig"
#define LAMPS     9
#define CAMERA_MM 650.0
#define FOCAL_PX  4160
#define SIDE      480
#define BALL_MM   10.0 /* radius */
#define BALL_X_MM 18.0
#define BALL_Y_MM 14.0
/* At this azimuth the picture of a camera overhead has the rig's x to the right and y up. */
#define CAMERA                                                                                     \
    "theta_deg = 0\nphi_deg = 270\ndistance_mm = 650\nwidth = 480\nheight = 480\n"                 \
    "focal_px = 4160\nresponse = 6000\n"

/* Three lamps on each of three rings. */
static struct vec3 lamp_mm(int i, double dome_mm) {
    return vec3_scale(rig_direction((20 + 20 * (int)(i / 3)) * G_PI / 180, i % 3 * 2 * G_PI / 3),
                      dome_mm);
}

static void write_rig(const char *folder, double dome_mm) {
    g_autoptr(GString) world = g_string_new(
        "[world]\nseed = 11\nnoise = yes\nsupersample = 3\ngather_rays = 4\ncache_mb = 64\n"
        "turntable_albedo = 0.04\nturntable_radius_mm = 60\n"
        "[sample]\nkind = balls\nwidth_mm = 56\nheight_mm = 56\nbase_mm = 0\ntop_mm = 26\n"
        "places_mm = 18;14;10\n[camera cam]\n" CAMERA);
    for (int i = 0; i < LAMPS; i++)
        g_string_append_printf(world,
                               "[lamp dome_%02d]\ntheta_deg = %d\nphi_deg = %d\ndistance_mm = %g\n"
                               "exponent = 2\nintensity = 25\n",
                               i + 1, 20 + 20 * (int)(i / 3), i % 3 * 120, dome_mm);
    text_file_write(folder, "world.conf", world->str);
    g_autofree char *rig = g_strdup_printf(
        "[rig]\nid = dome\nclock = virtual\n"
        "[lamps dome]\ndriver = sim-lamps\nworld = world.conf\nrings = 20:3; 40:3; 60:3\n"
        "distance_mm = %g\nexponent = 2\nintensity = 25\n"
        "[camera cam]\ndriver = sim-camera\nworld = world.conf\n" CAMERA,
        dome_mm);
    text_file_write(folder, "rig.conf", rig);
    text_file_write(folder, "session.conf",
                    "[session]\nname = ball\n[sample]\nwidth_mm = 50\nheight_mm = 50\ntexels = 16\n"
                    "reference_mm = 1\ndepth_mm = 1\n[views]\ndevices = all\n[lights]\n"
                    "devices = all\n[capture]\nexposures_us = 4000\n");
}

static char *run(const char *folder, const char *const *argv) {
    char *out = NULL, *errors = NULL;
    const int code = process_run_in(folder, argv, &out, &errors);
    char *all = g_strconcat(out, errors, NULL);
    g_free(out);
    g_free(errors);
    if (code != 0)
        g_error("%s", all);
    return all;
}

/* Captures the ball under each lamp. The photographs of the folder "photos" are those of the lamps,
 * in their order. */
static void photograph(const char *folder, double dome_mm) {
    write_rig(folder, dome_mm);
    g_free(run(folder, (const char *[]){MESORIG, "capture", "rig.conf", "session.conf", "-o",
                                        "ball.session", "--yes", NULL}));
    g_autofree char *photos = g_build_filename(folder, "photos", NULL);
    g_assert_cmpint(g_mkdir_with_parents(photos, 0700), ==, 0);
    for (int i = 0; i < LAMPS; i++) {
        /* The first frame is dark. */
        g_autofree char *from = g_strdup_printf("../ball.session/frames/%06d_cam.exr", i + 2);
        g_autofree char *to = g_strdup_printf("%s/%02d.exr", photos, i);
        g_assert_cmpint(symlink(from, to), ==, 0);
    }
}

struct off {
    double positions_mm, directions_mm; /* RMS errors: positions; directions at the same distance */
    double worst_mm, bars;              /* largest error of a position; error over error bar, RMS */
};

/* Calibrates with the focal length, or as if the camera were far away, and compares with the truth.
 */
static struct off calibrate(const char *folder, double dome_mm, gboolean focal) {
    g_autofree char *dome = g_strdup_printf("--dome-radius=%g", dome_mm);
    const double px_mm = FOCAL_PX / (CAMERA_MM - BALL_MM);
    g_autofree char *ball =
        g_strdup_printf("--ball=%.1f,%.1f,%.1f", (SIDE - 1) / 2.0 + px_mm * BALL_X_MM + 0.7,
                        (SIDE - 1) / 2.0 - px_mm * BALL_Y_MM - 0.5, px_mm * BALL_MM + 0.8);
    const char *const argv[] = {MESORIG,
                                "calibrate",
                                "lights",
                                "--images",
                                "photos",
                                ball,
                                "--radius=10",
                                dome,
                                "-o",
                                "lights.lp",
                                "--force",
                                "--within=2",
                                focal ? "--focal=4160" : NULL,
                                NULL};
    g_autofree char *out = run(folder, argv);
    struct off ret = {0};
    g_test_message("%s", out);
    for (int i = 0; i < LAMPS; i++) {
        const struct vec3 truth = lamp_mm(i, dome_mm);
        struct vec3 d, at;
        double sigma_deg, error_mm;
        g_autofree char *name = g_strdup_printf("%02d.exr", i);
        const char *line = strstr(out, name);
        g_assert_nonnull(line);
        g_assert_cmpint(sscanf(line + strlen(name),
                               "%lf %lf %lf ± %lf°   on the dome at %lf %lf %lf mm, ± %lf", &d.x,
                               &d.y, &d.z, &sigma_deg, &at.x, &at.y, &at.z, &error_mm),
                        ==, 8);
        const double off_mm = vec3_length(vec3_sub(at, truth));
        ret.positions_mm += off_mm * off_mm / LAMPS;
        ret.directions_mm +=
            pow(vec3_length(vec3_sub(vec3_scale(vec3_unit(d), dome_mm), truth)), 2) / LAMPS;
        ret.worst_mm = MAX(ret.worst_mm, off_mm);
        ret.bars += pow(off_mm / error_mm, 2) / LAMPS;
    }
    ret.positions_mm = sqrt(ret.positions_mm);
    ret.directions_mm = sqrt(ret.directions_mm);
    ret.bars = sqrt(ret.bars);
    g_test_message(
        "%g mm, %s: positions %.2f mm RMS, %.2f mm at most, %.2f error bars; directions only "
        "%.1f mm RMS",
        dome_mm, focal ? "known focal length" : "camera taken for far", ret.positions_mm,
        ret.worst_mm, ret.bars, ret.directions_mm);
    return ret;
}

/* The list as the positions of a bank. */
static void assert_rig_reads(const char *folder, double dome_mm) {
    static const char text[] =
        "[rig]\nid = dome\nclock = virtual\n"
        "[lamps dome]\ndriver = sim-lamps\nworld = world.conf\npositions = lights.lp\n"
        "[camera cam]\ndriver = sim-camera\nworld = world.conf\n" CAMERA;
    g_autofree char *path = g_build_filename(folder, "placed.conf", NULL);
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    text_file_write(folder, "placed.conf", text);
    ok(devices_parse_geometry(text, path, rig, ERR));
    g_assert_cmpint(rig->n_lamps, ==, LAMPS);
    for (int i = 0; i < LAMPS; i++)
        g_assert_cmpfloat(vec3_length(vec3_sub(rig->lamps[i].position_mm, lamp_mm(i, dome_mm))), <,
                          1);
}

/* The radius of the dome is two, three and six widths of the sample. */
TEST(positions) {
    static const double domes_mm[] = {100, 150, 300};
    for (gsize i = 0; i < G_N_ELEMENTS(domes_mm); i++) {
        TEMPORARY_FOLDER(folder);
        const double mm = domes_mm[i];
        photograph(folder, mm);
        const struct off far = calibrate(folder, mm, FALSE), known = calibrate(folder, mm, TRUE);
        assert_rig_reads(folder, mm);
        g_assert_cmpfloat(known.worst_mm, <, 1);
        g_assert_cmpfloat(known.bars, <, 1.5);
        g_assert_cmpfloat(known.directions_mm, >, 20);
        g_assert_cmpfloat(far.positions_mm, <, far.directions_mm / 1.5);
    }
}

/* Options that do not fit each other. */
TEST(mistakes) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *photos = g_build_filename(folder, "photos", NULL);
    g_assert_cmpint(g_mkdir_with_parents(photos, 0700), ==, 0);
    static const struct {
        const char *options[3], *says;
    } cases[] = {
        {{"--dome-radius=150"}, "also give the radius of the balls with --radius"},
        {{"--dome-radius=5", "--radius=10"}, "the dome must be larger"},
        {{"--dome-middle=3,4"}, "give X,Y in pixels, and --dome-radius"},
        {{"--dome-radius=150", "--radius=10", "--dome-middle=3"}, "--dome-middle=3: give X,Y"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        const char *const *o = cases[i].options;
        const char *const argv[] = {MESORIG,  "calibrate", "lights",           "--images",
                                    "photos", "-o",        "lights.lp",        "--ball=90,90,50",
                                    o[0],     o[1],        o[1] ? o[2] : NULL, NULL};
        g_autofree char *errors = NULL;
        g_assert_cmpint(process_run_in(folder, argv, NULL, &errors), ==, 2);
        assert_has(errors, cases[i].says);
    }
}
