/* Rigs of other shapes than the demo's, from beginning to end, next to the simulated truth: a dome
 * of 64 LEDs around one camera (etc/demo/dome), of which PTM and HSH are made; and four cameras and
 * sixteen lamps that stand around a turntable (etc/demo/fixed_lamps), whose lamps are calibrated,
 * of which a BTF is made; and two cameras on an arm (etc/demo/arm), whose poses and axis are
 * calibrated from boards, and a BTF; and one lamp on a probe that the arc carries (etc/demo/probe),
 * whose stops are calibrated as lamps, and a BTF. */
#include "calibration/calibration.h"
#include "exr/exr.h"
#include "geometry/swing.h"
#include "lib/floats.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "rig/devices.h"
#include "session/session.h"
#include "world/truth.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEMO    SOURCE_DIR "/etc/demo/"
#define SAMPLES 12 /* rays a texel of the truth, across and down */
#define LEAST   0.02
#define DEG     (180 / G_PI)

enum deviating {
    NOTHING,
    LAMPS,
    CAMERAS
}; /* from the rig file; what else the world has is exact */

static gboolean deviates(const char *key, enum deviating what) {
    const gboolean lamp = g_str_has_prefix(key, "lamp") || g_str_has_prefix(key, "arc") ||
                          g_str_has_prefix(key, "probe");
    return what == LAMPS ? lamp : what == CAMERAS && !lamp;
}

/* A rig of etc/demo in a folder of its own, with another [sample] of the world where one is given;
 * a name that begins with "still": without its turntable, with "stuck": its arm does not move,
 * though the axis says so. Returns the folder. */
static char *lay_down(const char *name, const char *shape, const char *sample,
                      enum deviating what) {
    g_autofree char *from = g_build_filename(DEMO, shape, NULL);
    g_autofree char *rig_from = g_build_filename(from, "rig.conf", NULL);
    g_autofree char *world_from = g_build_filename(from, "world.conf", NULL);
    g_autofree char *rig = text_file_read(rig_from), *world = text_file_read(world_from),
                    *old = NULL;
    char *to = in_folder(name);
    g_autofree char *rig_to = g_build_filename(to, "rig.conf", NULL);
    g_autofree char *world_to = g_build_filename(to, "world.conf", NULL);
    g_autoptr(GKeyFile) file = g_key_file_new();

    g_assert_cmpint(g_mkdir(to, 0700), ==, 0);
    const gboolean still = g_str_has_prefix(name, "still");
    if (still || g_str_has_prefix(name, "stuck")) {
        ok(g_key_file_load_from_data(file, rig, strlen(rig), G_KEY_FILE_NONE, ERR));
        g_assert_true(still ? g_key_file_remove_group(file, "axis turntable", NULL)
                            : g_key_file_remove_key(file, "axis arm", "world", NULL));
        g_free(rig);
        rig = g_key_file_to_data(file, NULL, NULL);
    }
    g_assert_true(g_file_set_contents(rig_to, rig, -1, NULL));
    ok(g_key_file_load_from_data(file, world, strlen(world), G_KEY_FILE_NONE, ERR));
    g_key_file_set_value(file, "world", "gather_rays", "0");
    g_auto(GStrv) keys = g_key_file_get_keys(file, "world", NULL, NULL);
    for (char **key = keys; *key; key++)
        if (strstr(*key, "_error_") && !deviates(*key, what))
            g_key_file_remove_key(file, "world", *key, NULL);
    if (sample)
        g_key_file_remove_group(file, "sample", NULL);
    old = g_key_file_to_data(file, NULL, NULL);
    g_autofree char *text = g_strconcat(old, sample ? "\n[sample]\n" : "", sample, NULL);
    g_assert_true(g_file_set_contents(world_to, text, -1, NULL));
    return to;
}

/* Captures one into NAME.session; more: arguments. */
static char *capture(const char *name, const char *shape, const char *sample, enum deviating what,
                     const char *conf, const char *more) {
    g_autofree char *to = lay_down(name, shape, sample, what);
    g_autofree char *path = g_build_filename(to, "session.conf", NULL);
    char *session = g_strconcat(to, ".session", NULL);

    g_assert_true(g_file_set_contents(path, conf, -1, NULL));
    g_free(process_mesorig(0, "capture %s/rig.conf %s -o %s%s", to, path, session, more));
    return session;
}

#define CONF(size, height, texels, views, lights, capture)                                         \
    "[session]\nname=s\n[sample]\nwidth_mm=" size "\nheight_mm=" size "\ntexels=" texels           \
    "\nreference_mm=" height "\ndepth_mm=" height "\n[views]\n" views "\n[lights]\n" lights        \
    "\n[capture]\non_blocked=skip\n" capture "\n"

struct errors {
    double median, p95;
};

/* The world's camera and lamp that one of the rig's is, or is a stop of. */
static int world_camera(World *world, const struct rig *rig, int camera) {
    char name[RIG_NAME];

    rig_stop_device(rig->cameras[camera].name, rig->cameras[camera].on_arm, name);
    return world_find_camera(world, name);
}

static int world_lamp(World *world, const struct rig *rig, int lamp) {
    char name[RIG_NAME];

    rig_stop_device(rig->lamps[lamp].name, rig->lamps[lamp].on_probe, name);
    return world_find_lamp(world, name);
}

/* Of a BTF's green values next to the truth, of every n-th light of every n-th view. */
static struct errors btf_errors(const char *session_path, const char *world_path, int texels,
                                int every) {
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Session) session = session_open(session_path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) views = session_views(session, &error);
    g_autofree char *calibration = session_text(session, "calibration.conf", &error);
    struct rig rig;
    g_assert_true(rig_from_text(&rig, calibration, NULL, &error));
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(float));
    const struct truth_grid grid = {texels, texels, 50, 50, 2.2};
    g_autofree float *truth = g_new(float, texels *texels * 3);

    for (guint v = 0; v < views->len; v += (guint)every)
        for (guint i = 0; i < shots->len; i++) {
            const struct session_direction *view = views->pdata[v];
            const struct session_shot *shot = shots->pdata[i];
            if (shot->kind != SHOT_LAMP || shot->source % every != (int)v % every ||
                !camera_set_has(shot->cameras, view->device) ||
                fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
                continue;
            g_autofree char *path =
                g_strdup_printf("%s/products/btf/view_%04u.exr", session_path, v);
            g_autofree char *part_name = g_strdup_printf("light_%04d", shot->source);
            struct exr_part *part = ok(exr_read_part(path, part_name, ERR));
            world_set_arm(world, rig_arm_deg(&rig, shot->cameras));
            world_set_probe(world, rig_probe_deg(&rig, shot->device));
            truth_btf(world, world_camera(world, &rig, view->device),
                      world_lamp(world, &rig, shot->device), shot->turntable_deg, shot->arc_deg,
                      &grid, SAMPLES, truth);
            for (int t = 0; t < texels * texels; t++) {
                const float off = fabsf(exr_part_plane(part, "G")[t] - truth[3 * t + 1]) /
                                  MAX(truth[3 * t + 1], (float)LEAST);
                g_array_append_val(errors, off);
            }
            exr_part_free(part);
        }
    g_assert_cmpint((int)errors->len, >=, 8 * texels * texels);
    g_array_sort(errors, floats_by_value);
    return (struct errors){100 * (double)g_array_index(errors, float, errors->len / 2),
                           100 * (double)g_array_index(errors, float, errors->len * 95 / 100)};
}

/* What the codec says of its error, in per cent. */
static double error_of(const char *session, const char *method) {
    g_autofree char *text = process_mesorig(0, "compress %s --method %s --json", session, method);
    const char *at = strstr(text, "\"error\":");

    g_assert_nonnull(at);
    return 100 * g_ascii_strtod(at + strlen("\"error\":"), NULL);
}

/* One view under 64 lights: planned as such, captured without an axis, fitted, drawn. */
TEST(dome) {
    g_autofree char *conf = NULL, *session = NULL, *world = NULL, *plan = NULL, *height = NULL;
    g_autofree char *picture = in_folder("dome.png");

    plan = process_mesorig(0, "plan " DEMO "dome/rig.conf " DEMO "dome/session.conf");
    assert_has(plan, "1 view, 64 lights");
    assert_has(plan, "RTI");
    session = capture(
        "dome", "dome", NULL, NOTHING,
        CONF("50", "2.2", "32", "devices=all", "devices=all", "exposures_us=4000;16000"), "");
    g_free(process_mesorig(0, "process %s", session));
    world = in_folder("dome/world.conf");
    const struct errors btf = btf_errors(session, world, 32, 4);
    const double ptm = error_of(session, "ptm"), hsh = error_of(session, "hsh");
    g_test_message("dome: BTF %.2f %% / %.1f %% (95th percentile) of the truth; PTM %.1f %%, HSH "
                   "%.1f %% of the BTF",
                   btf.median, btf.p95, ptm, hsh);
    g_assert_cmpfloat(btf.median, <, 1.2);
    g_assert_cmpfloat(btf.p95, <, 8);
    g_assert_cmpfloat(hsh, <, ptm);
    g_assert_cmpfloat(ptm, <, 15);
    height = in_folder("height.exr");
    g_free(process_mesorig(0, "export normals %s -o %s", session, height));
    const char *const view[] = {BUILD_DIR "/bin/mesorig-view",
                                session,
                                "--reference",
                                "--render",
                                picture,
                                "--shape",
                                "plane",
                                "--size",
                                "64x48",
                                NULL};
    g_free(process_text(0, view));
    g_assert_true(g_file_test(picture, G_FILE_TEST_IS_REGULAR));
}

#define POSTS                                                                                      \
    "-21.4;-19.6;24;20.5;-23.5;12;24.4;18.7;24;-18.1;24.5;12;0.3;8.4;20;-5.7;-13.5;5;12.4;2.6;5;"  \
    "-15.7;4.1;5"

#define POSTS_CONF(views, lights) CONF("60", "20", "8", views, lights, "exposures_us=2000;8000")
#define TILE_CONF(views, lights)                                                                   \
    CONF("60", "2.2", "8", views, lights,                                                          \
         "exposures_us=1000;1000;3000;3000;7000;7000\nkeep_exposures=yes")

/* Lamps from posts, as etc/demo/calibrate does it. Returns what calibrate lights has told. */
static char *calibrate_lights(const char *name, const char *shape, const char *posts_conf,
                              const char *to) {
    g_autofree char *posts =
        capture(name, shape,
                "kind=poles\nwidth_mm=84\nheight_mm=84\nbase_mm=2\ntop_mm=40\nradius_mm=1\n"
                "places_mm=" POSTS "\n",
                LAMPS, posts_conf, "");
    return process_mesorig(0, "calibrate lights %s --target " DEMO "poles.conf -o %s", posts, to);
}

/* The same, and light from a tile. */
static char *calibrate(const char *shape, const char *posts_conf, const char *tile_conf,
                       const char *to) {
    g_autofree char *posts_name = g_strdup_printf("%s_posts", shape);
    g_autofree char *tile_name = g_strdup_printf("%s_tile", shape);
    g_autofree char *tile = NULL;

    char *told = calibrate_lights(posts_name, shape, posts_conf, to);
    tile = capture(tile_name, shape,
                   "kind=flat\nwidth_mm=60\nheight_mm=60\nbase_mm=2.2\nalbedo=0.96\n", LAMPS,
                   tile_conf, "");
    g_free(
        process_mesorig(0, "calibrate radiometry %s --reflectance 0.96 -c %s -o %s", tile, to, to));
    return told;
}

/* Worst angle between where a lamp is and was found, seen from the origin, degrees. */
static double worst_lamp_deg(const struct rig *rig, World *world) {
    double worst = 0;

    for (int i = 0; i < rig->n_lamps; i++) {
        double at[3];
        world_set_probe(world, rig->lamps[i].probe_deg);
        truth_lamp(world, world_lamp(world, rig, i), 0, at, NULL);
        const struct vec3 truth = vec3(at[0], at[1], at[2]),
                          found = rig_lamp_position_mm(&rig->arc, &rig->lamps[i], 0);
        worst =
            MAX(worst, DEG * atan2(vec3_length(vec3_cross(truth, found)), vec3_dot(truth, found)));
    }
    return worst;
}

TEST(fixed_lamps) {
    g_autofree char *to = in_folder("rig.calibration");
    g_autoptr(GError) error = NULL;

    g_autofree char *told = calibrate("fixed_lamps", POSTS_CONF("rings=35:2;55:2", "devices=all"),
                                      TILE_CONF("rings=15:2;35:2;55:2;75:2", "devices=all"), to);
    g_assert_null(strstr(told, "arc: ")); /* there is none */
    g_autofree char *more = g_strdup_printf(" -c %s", to);
    g_autofree char *session = capture("weave", "fixed_lamps", NULL, LAMPS,
                                       CONF("50", "2.2", "16", "rings=15:1;35:1;55:1;75:1",
                                            "devices=all", "exposures_us=4000;16000"),
                                       more);
    g_autofree char *world_path = in_folder("weave/world.conf");
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Calibration) found = calibration_read(to, &error);
    g_assert_no_error(error);
    const double lamp_deg = worst_lamp_deg(&found->rig, world);
    g_free(process_mesorig(0, "process %s", session));
    const struct errors calibrated = btf_errors(session, world_path, 16, 2);
    g_free(process_mesorig(0, "process %s -c nominal", session));
    const struct errors nominal = btf_errors(session, world_path, 16, 2);
    g_test_message(
        "fixed lamps: worst lamp %.3f° off; BTF %.2f %% / %.1f %% (95th percentile) of the "
        "truth calibrated, %.1f %% / %.1f %% by the rig file",
        lamp_deg, calibrated.median, calibrated.p95, nominal.median, nominal.p95);
    g_assert_cmpfloat(lamp_deg, <, 0.2);
    g_assert_cmpfloat(calibrated.median, <, 2);
    g_assert_cmpfloat(calibrated.median, <, 0.7 * nominal.median);
}

#define PROBE_LIGHTS(n) "rings=15:" n ";30:" n ";45:" n ";60:" n ";75:" n "\noffset_deg=22.5"

/* Five stops of one lamp, each calibrated as a lamp; the arc turns all of them. */
TEST(probe) {
    g_autofree char *to = in_folder("probe.calibration");
    g_autoptr(GError) error = NULL;

    g_free(calibrate("probe", POSTS_CONF("rings=20:1;40:1;60:1", PROBE_LIGHTS("4")),
                     TILE_CONF("rings=20:2;40:2;60:2", PROBE_LIGHTS("2")), to));
    g_autofree char *more = g_strdup_printf(" -c %s", to);
    g_autofree char *session = capture("probe_weave", "probe", NULL, LAMPS,
                                       CONF("50", "2.2", "16", "rings=20:1;40:1;60:1",
                                            PROBE_LIGHTS("4"), "exposures_us=4000;16000"),
                                       more);
    g_autofree char *world_path = in_folder("probe_weave/world.conf");
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Calibration) found = calibration_read(to, &error);
    g_assert_no_error(error);
    g_assert_cmpint(found->rig.n_lamps, ==, 5);
    const double lamp_deg = worst_lamp_deg(&found->rig, world);
    g_free(process_mesorig(0, "process %s", session));
    const struct errors calibrated = btf_errors(session, world_path, 16, 2);
    g_free(process_mesorig(0, "process %s -c nominal", session));
    const struct errors nominal = btf_errors(session, world_path, 16, 2);
    g_test_message("probe: worst stop %.3f° off; BTF %.2f %% / %.1f %% (95th percentile) of the "
                   "truth calibrated, %.1f %% / %.1f %% by the rig file",
                   lamp_deg, calibrated.median, calibrated.p95, nominal.median, nominal.p95);
    g_assert_cmpfloat(lamp_deg, <, 0.1);
    g_assert_cmpfloat(calibrated.median, <, 1.5);
    g_assert_cmpfloat(calibrated.median, <, 0.5 * nominal.median);
}

#define BOARD "8x8,square=9,marker=6.75,thickness=3"
#define BOARD_PLATE                                                                                \
    "kind=plate\nwidth_mm=72\nheight_mm=72\nbase_mm=3\ntop_mm=200\nalbedo_path=../board.png\n"
/* The high camera at two of its three stops, the low one at all. */
#define BOARD_CONF                                                                                 \
    CONF("72", "3", "8", "rings=15:4;35:4;45:4;55:4;75:4", "rings=30:1\noffset_deg=22.5",          \
         "exposures_us=8000")

struct camera_errors { /* the worst of several cameras */
    double mm, deg;    /* of position and viewing direction */
    double px;         /* of where points of a sample of 50 mm are seen */
};

/* The turn and the shift in the plane z = 0 from the found rig to the true world: least squares
 * over the points at which the cameras, as found, see four marks of the world. */
static double plane_turn(const struct rig *rig, World *world, struct vec3 *ret_off) {
    double px = 0, py = 0, qx = 0, qy = 0, across = 0, along = 0, n = 0;

    for (int c = 0; c < rig->n_cameras; c++)
        for (int i = 0; i < 4; i++) {
            const double q[3] = {i % 2 ? 20 : -20, i / 2 ? 20 : -20, 0};
            double xy[2];
            truth_project(world, world_camera(world, rig, c), q, xy);
            const struct vec3 ray = rig_pixel_ray(&rig->cameras[c], xy[0], xy[1]);
            const struct vec3 eye = rig_camera_centre_mm(&rig->cameras[c]);
            const double x = eye.x - ray.x / ray.z * eye.z, y = eye.y - ray.y / ray.z * eye.z;
            px += x, py += y, qx += q[0], qy += q[1], n++;
            across += x * q[1] - y * q[0];
            along += x * q[0] + y * q[1];
        }
    const double turn = atan2(across - (px * qy - py * qx) / n, along - (px * qx + py * qy) / n);
    const struct vec3 p = rig_turn(vec3(px / n, py / n, 0), turn);
    *ret_off = vec3(qx / n - p.x, qy / n - p.y, 0);
    return turn;
}

/* Of those cameras in a set of bits, next to where they truly are. The rig's azimuth 0 is free: it
 * is compared after a turn about z that brings the mean azimuths together; without a turntable
 * (still) the origin is free as well, in x and y. */
static struct camera_errors camera_errors(const struct rig *rig, World *world, guint32 of,
                                          gboolean still) {
    struct camera_errors worst = {0};
    struct truth_camera truth[RIG_MAX_CAMERAS];
    struct vec3 off = vec3(0, 0, 0);
    const int n = rig->n_cameras;
    double turn = 0;

    for (int c = 0; c < n; c++) {
        const struct vec3 found = rig_camera_centre_mm(&rig->cameras[c]);
        world_set_arm(world, rig->cameras[c].arm_deg);
        truth_camera(world, world_camera(world, rig, c), &truth[c]);
        turn +=
            remainder(atan2(truth[c].centre_mm[1], truth[c].centre_mm[0]) - atan2(found.y, found.x),
                      2 * G_PI) /
            n;
    }
    if (still)
        turn = plane_turn(rig, world, &off);
    for (int c = 0; c < n; c++) {
        if (!(of >> c & 1))
            continue;
        const struct rig_camera *camera = &rig->cameras[c];
        const double *row = camera->rotation.m[2], *centre = truth[c].centre_mm;
        const struct vec3 at = vec3_add(rig_turn(rig_camera_centre_mm(camera), turn), off);
        const struct vec3 to = rig_turn(vec3(row[0], row[1], row[2]), turn);
        const struct vec3 forward =
            vec3(truth[c].forward[0], truth[c].forward[1], truth[c].forward[2]);
        worst.mm = MAX(worst.mm, vec3_length(vec3_sub(at, vec3(centre[0], centre[1], centre[2]))));
        worst.deg = MAX(worst.deg, DEG * vec3_length(vec3_cross(to, forward)));
        world_set_arm(world, camera->arm_deg);
        for (int i = 0; i < 9; i++) {
            const struct vec3 p = vec3(25 * (i % 3 - 1), 25 * (i / 3 - 1), 2.2);
            const struct vec3 truly = vec3_add(rig_turn(p, turn), off);
            double x, y, xy[2];
            truth_project(world, world_camera(world, rig, c),
                          (double[3]){truly.x, truly.y, truly.z}, xy);
            g_assert_true(rig_project(camera, p, &x, &y));
            worst.px = MAX(worst.px, hypot(x - xy[0], y - xy[1]));
        }
    }
    return worst;
}

/* Two sessions of a board on the arm's rig, and the calibration from them. Returns what it has
 * told. */
static char *calibrate_boards(const char *name, int code, const char *to) {
    g_autofree char *flat_name = g_strdup_printf("%s_flat", name);
    g_autofree char *leaning_name = g_strdup_printf("%s_leaning", name);
    g_autofree char *board = in_folder("board.png");

    g_free(process_mesorig(0, "board %s --board " BOARD " --pixels 0.8888888888888888", board));
    g_autofree char *flat = capture(flat_name, "arm", BOARD_PLATE "turn_deg=3\noffset_mm=1;-2\n",
                                    CAMERAS, BOARD_CONF, "");
    g_autofree char *leaning =
        capture(leaning_name, "arm",
                BOARD_PLATE "tilt_deg=20\ntilt_towards_deg=100\nturn_deg=63\noffset_mm=1;0\n",
                CAMERAS, BOARD_CONF, "");
    return process_mesorig(code, "calibrate cameras %s %s --board " BOARD " -o %s", flat, leaning,
                           to);
}

/* Nothing is written of an arm that says it moves, and does not. */
TEST(stuck_arm) {
    g_autofree char *to = in_folder("stuck.calibration");
    g_autofree char *told = calibrate_boards("stuck", 1, to);

    g_test_message("%s", told);
    assert_has(told, "[axis arm]");
    g_assert_false(g_file_test(to, G_FILE_TEST_EXISTS));
}

/* Boards at the arm's stops: every stop's pose, the axis, and the stop that was left out. */
TEST(arm) {
    g_autofree char *to = in_folder("arm.calibration");
    g_autoptr(GError) error = NULL;

    g_autofree char *told = calibrate_boards("arm", 0, to);
    assert_has(told, "1 stop without pictures is placed by the axis");
    g_autoptr(Calibration) found = calibration_read(to, &error);
    g_assert_no_error(error);

    g_autofree char *more = g_strdup_printf(" -c %s", to);
    g_autofree char *session = capture("arm_weave", "arm", NULL, CAMERAS,
                                       CONF("50", "2.2", "16", "rings=15:1;25:1;55:1;75:1",
                                            "devices=all", "exposures_us=4000;16000"),
                                       more);
    g_autofree char *world_path = in_folder("arm_weave/world.conf");
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    const struct rig *rig = &found->rig;
    const int left_out = 1; /* high@10 */
    struct truth_swing arm;
    truth_arm(world, &arm);
    g_assert_cmpint(found->cameras[left_out].points, ==, 0);
    const struct camera_errors seen = camera_errors(rig, world, ~(1u << left_out), FALSE);
    const struct camera_errors placed = camera_errors(rig, world, 1u << left_out, FALSE);
    const struct vec3 axis = vec3(arm.axis[0], arm.axis[1], arm.axis[2]);
    const double axis_deg = DEG * vec3_length(vec3_cross(rig->arm.axis, axis));
    const struct vec3 between =
        vec3_sub(rig->arm.centre_mm, vec3(arm.centre_mm[0], arm.centre_mm[1], arm.centre_mm[2]));
    const double axis_mm =
        vec3_length(vec3_sub(between, vec3_scale(axis, vec3_dot(between, axis))));
    struct rig meant;
    struct rig_swing_fit fit;
    g_assert_true(devices_read_geometry(DEMO "arm/rig.conf", &meant, &error));
    g_assert_true(
        rig_swing_fit(rig, (struct camera_set){{~((guint64)1 << left_out)}}, &meant, &fit));
    const double zero_deg = DEG * fit.zero_rad - arm.zero_deg;
    g_free(process_mesorig(0, "process %s", session));
    const struct errors calibrated = btf_errors(session, world_path, 16, 2);
    g_free(process_mesorig(0, "process %s -c nominal", session));
    const struct errors nominal = btf_errors(session, world_path, 16, 2);
    g_test_message(
        "camera arm: stops at worst %.3f mm, %.4f°, %.3f px off, the one without pictures "
        "%.3f mm, %.4f°, %.3f px; axis %.4f° and %.3f mm, zero %.4f° (%.4f°); BTF %.2f %% / %.1f "
        "%% (95th "
        "percentile) of the truth calibrated, %.1f %% / %.1f %% by the rig file",
        seen.mm, seen.deg, seen.px, placed.mm, placed.deg, placed.px, axis_deg, axis_mm, zero_deg,
        arm.zero_deg, calibrated.median, calibrated.p95, nominal.median, nominal.p95);
    g_assert_cmpfloat(seen.px, <, 0.3);
    g_assert_cmpfloat(seen.mm, <, 0.8);
    g_assert_cmpfloat(placed.px, <, 0.6);
    g_assert_cmpfloat(placed.mm, <, 0.5);
    g_assert_cmpfloat(axis_deg, <, 0.06);
    g_assert_cmpfloat(axis_mm, <, 0.3);
    g_assert_cmpfloat(fabs(zero_deg), <, 0.08); /* cameras stand 0.3 mm off, which is 0.03° */
    g_assert_cmpfloat(calibrated.median, <, 2.5);
    g_assert_cmpfloat(calibrated.median, <, 0.4 * nominal.median);
}

/* Four cameras around a board that lies flat and leans in five directions, and nothing that turns.
 * The lamps are calibrated from posts. */
TEST(still) {
    static const char *const lays[] = {
        "turn_deg=3\noffset_mm=1;-2\n",
        "tilt_deg=20\ntilt_towards_deg=10\nturn_deg=63\noffset_mm=1;0\n",
        "tilt_deg=25\ntilt_towards_deg=100\nturn_deg=20\noffset_mm=0;1\n",
        "tilt_deg=20\ntilt_towards_deg=190\nturn_deg=40\noffset_mm=-1;1\n",
        "tilt_deg=25\ntilt_towards_deg=280\nturn_deg=75\noffset_mm=1;-1\n",
        "tilt_deg=15\ntilt_towards_deg=45\nturn_deg=10\noffset_mm=0;0\n"};
    g_autofree char *to = in_folder("still.calibration");
    g_autofree char *board = in_folder("board.png");
    g_autoptr(GString) sessions = g_string_new(NULL);
    g_autoptr(GError) error = NULL;

    g_free(process_mesorig(0, "board %s --board " BOARD " --pixels 0.8888888888888888", board));
    for (gsize i = 0; i < G_N_ELEMENTS(lays); i++) {
        g_autofree char *name = g_strdup_printf("still_board%d", (int)i);
        g_autofree char *plate = g_strconcat(BOARD_PLATE, lays[i], NULL);
        g_autofree char *session = capture(
            name, "fixed_lamps", plate, CAMERAS,
            CONF("72", "3", "8", "devices=all", "devices=lamp30_2", "exposures_us=8000"), "");
        g_string_append_printf(sessions, "%s ", session);
    }
    g_autofree char *told =
        process_mesorig(0, "calibrate cameras %s--board " BOARD " -o %s", sessions->str, to);
    g_autoptr(Calibration) found = calibration_read(to, &error);
    g_assert_no_error(error);
    g_autofree char *world_path = in_folder("still_board0/world.conf");
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    struct rig nominal;
    g_autofree char *rig_path = g_build_filename(DEMO, "fixed_lamps", "rig.conf", NULL);
    g_assert_true(devices_read_geometry(rig_path, &nominal, &error));
    const struct camera_errors errors = camera_errors(&found->rig, world, ~0u, TRUE);
    const struct camera_errors before = camera_errors(&nominal, world, ~0u, TRUE);
    g_test_message(
        "without a turntable: cameras at worst %.3f mm, %.4f°, %.3f px off; by the rig file "
        "%.3f mm, %.4f°, %.3f px",
        errors.mm, errors.deg, errors.px, before.mm, before.deg, before.px);
    g_assert_cmpfloat(errors.px, <, 0.25);
    g_assert_cmpfloat(errors.px, <, 0.1 * before.px);
    g_assert_cmpfloat(errors.deg, <, 0.2);

    g_autofree char *lamps_to = in_folder("still_lamps.calibration");
    g_free(calibrate_lights("still_posts", "fixed_lamps", POSTS_CONF("devices=all", "devices=all"),
                            lamps_to));
    g_autofree char *lamps_world = in_folder("still_posts/world.conf");
    g_autoptr(World) posts = world_get(lamps_world, &error);
    g_assert_no_error(error);
    g_autoptr(Calibration) lamps = calibration_read(lamps_to, &error);
    g_assert_no_error(error);
    const double lamp_deg = worst_lamp_deg(&lamps->rig, posts);
    g_test_message("without a turntable: worst lamp %.3f° off, %.3f° by the rig file", lamp_deg,
                   worst_lamp_deg(&nominal, posts));
    g_assert_cmpfloat(lamp_deg, <, 0.2);
}

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}
