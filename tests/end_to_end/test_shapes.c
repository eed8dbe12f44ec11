/* Rigs of other shapes than the demo's, from beginning to end, beside the simulated truth: a dome
 * of 64 LEDs around one camera (etc/demo/dome), of which PTM and HSH are made; and four cameras and
 * sixteen lamps that stand around a turntable (etc/demo/fixed_lamps), whose lamps are calibrated,
 * of which a BTF is made. */
#include "calibration/calibration.h"
#include "exr/exr.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "session/session.h"
#include "world/truth.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEMO    SOURCE_DIR "/etc/demo/"
#define SAMPLES 12 /* rays a texel of the truth, across and down */
#define LEAST   0.02
#define DEG     (180 / G_PI)

static char *folder;

static char *read_text(const char *path) {
    char *text = NULL;
    g_autoptr(GError) error = NULL;

    g_file_get_contents(path, &text, NULL, &error);
    g_assert_no_error(error);
    return text;
}

/* A rig of etc/demo in a folder of its own, with another [sample] of the world where one is given.
 * exact: all lamps are where the rig file says; cameras always are. Returns the folder. */
static char *lay_down(const char *name, const char *shape, const char *sample, gboolean exact) {
    g_autofree char *from = g_build_filename(DEMO, shape, NULL);
    g_autofree char *rig_from = g_build_filename(from, "rig.conf", NULL);
    g_autofree char *world_from = g_build_filename(from, "world.conf", NULL);
    g_autofree char *rig = read_text(rig_from), *world = read_text(world_from), *old = NULL;
    char *to = g_build_filename(folder, name, NULL);
    g_autofree char *rig_to = g_build_filename(to, "rig.conf", NULL);
    g_autofree char *world_to = g_build_filename(to, "world.conf", NULL);
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autoptr(GError) error = NULL;

    g_assert_cmpint(g_mkdir(to, 0700), ==, 0);
    g_assert_true(g_file_set_contents(rig_to, rig, -1, NULL));
    g_key_file_load_from_data(file, world, strlen(world), G_KEY_FILE_NONE, &error);
    g_assert_no_error(error);
    g_key_file_set_value(file, "world", "gather_rays", "0");
    g_auto(GStrv) keys = g_key_file_get_keys(file, "world", NULL, NULL);
    for (char **key = keys; *key; key++)
        if (strstr(*key, "_error_") && (exact || g_str_has_prefix(*key, "camera")))
            g_key_file_remove_key(file, "world", *key, NULL);
    if (sample)
        g_key_file_remove_group(file, "sample", NULL);
    old = g_key_file_to_data(file, NULL, NULL);
    g_autofree char *text = g_strconcat(old, sample ? "\n[sample]\n" : "", sample, NULL);
    g_assert_true(g_file_set_contents(world_to, text, -1, NULL));
    return to;
}

/* Captures one into NAME.session; more: arguments. */
static char *capture(const char *name, const char *shape, const char *sample, gboolean exact,
                     const char *conf, const char *more) {
    g_autofree char *to = lay_down(name, shape, sample, exact);
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

static int compare_floats(gconstpointer a, gconstpointer b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

struct errors {
    double median, p95;
};

/* Of a BTF's green values beside the truth, of every n-th light of every n-th view. */
static struct errors btf_errors(const char *session_path, const char *world_path, int texels,
                                int every) {
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Session) session = session_open(session_path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) views = session_views(session, &error);
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(float));
    const struct truth_grid grid = {texels, texels, 50, 50, 2.2};
    g_autofree float *truth = g_new(float, texels *texels * 3);

    for (guint v = 0; v < views->len; v += (guint)every)
        for (guint i = 0; i < shots->len; i++) {
            const struct session_direction *view = views->pdata[v];
            const struct session_shot *shot = shots->pdata[i];
            if (shot->kind != SHOT_LAMP || shot->source % every != (int)v % every ||
                !(shot->cameras >> view->device & 1) ||
                fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
                continue;
            g_autofree char *path =
                g_strdup_printf("%s/products/btf/view_%04u.exr", session_path, v);
            g_autofree char *part_name = g_strdup_printf("light_%04d", shot->source);
            struct exr_part *part = exr_read_part(path, part_name, &error);
            g_assert_no_error(error);
            truth_btf(world, view->device, shot->device, shot->turntable_deg, shot->arc_deg, &grid,
                      SAMPLES, truth);
            for (int t = 0; t < texels * texels; t++) {
                const float off = fabsf(exr_part_plane(part, "G")[t] - truth[3 * t + 1]) /
                                  MAX(truth[3 * t + 1], (float)LEAST);
                g_array_append_val(errors, off);
            }
            exr_part_free(part);
        }
    g_assert_cmpint((int)errors->len, >=, 8 * texels * texels);
    g_array_sort(errors, compare_floats);
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
static void test_dome(void) {
    g_autofree char *conf = NULL, *session = NULL, *world = NULL, *plan = NULL, *height = NULL;
    g_autofree char *picture = g_build_filename(folder, "dome.png", NULL);

    plan = process_mesorig(0, "plan " DEMO "dome/rig.conf " DEMO "dome/session.conf");
    assert_has(plan, "1 views, 64 lights");
    assert_has(plan, "RTI");
    session = capture(
        "dome", "dome", NULL, TRUE,
        CONF("50", "2.2", "32", "devices=all", "devices=all", "exposures_us=4000;16000"), "");
    g_free(process_mesorig(0, "process %s", session));
    world = g_build_filename(folder, "dome", "world.conf", NULL);
    const struct errors btf = btf_errors(session, world, 32, 4);
    const double ptm = error_of(session, "ptm"), hsh = error_of(session, "hsh");
    g_test_message("dome: BTF %.2f %% / %.1f %% (95th percentile) of the truth; PTM %.1f %%, HSH "
                   "%.1f %% of the BTF",
                   btf.median, btf.p95, ptm, hsh);
    g_assert_cmpfloat(btf.median, <, 1.2);
    g_assert_cmpfloat(btf.p95, <, 8);
    g_assert_cmpfloat(hsh, <, ptm);
    g_assert_cmpfloat(ptm, <, 15);
    height = g_build_filename(folder, "height.exr", NULL);
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

/* Lamps and light from targets on the turntable, as etc/demo/calibrate does it. */
static void calibrate(const char *to) {
    g_autofree char *posts = NULL, *tile = NULL;

    posts = capture(
        "posts", "fixed_lamps",
        "kind=poles\nwidth_mm=84\nheight_mm=84\nbase_mm=2\ntop_mm=40\nradius_mm=1\n"
        "places_mm=" POSTS "\n",
        FALSE, CONF("60", "20", "8", "rings=35:2;55:2", "devices=all", "exposures_us=2000;8000"),
        "");
    g_autofree char *told =
        process_mesorig(0, "calibrate lights %s --target " DEMO "poles.conf -o %s", posts, to);
    g_assert_null(strstr(told, "arc: ")); /* there is none */
    tile = capture("tile", "fixed_lamps",
                   "kind=flat\nwidth_mm=60\nheight_mm=60\nbase_mm=2.2\nalbedo=0.96\n", FALSE,
                   CONF("60", "2.2", "8", "rings=15:2;35:2;55:2;75:2", "devices=all",
                        "exposures_us=1000;1000;3000;3000;7000;7000\nkeep_exposures=yes"),
                   "");
    g_free(
        process_mesorig(0, "calibrate radiometry %s --reflectance 0.96 -c %s -o %s", tile, to, to));
}

/* Worst angle between where a lamp is and was found, seen from the origin, degrees. */
static double worst_lamp_deg(const struct rig *rig, World *world) {
    double worst = 0;

    for (int i = 0; i < rig->n_lamps; i++) {
        double at[3];
        truth_lamp(world, i, 0, at, NULL);
        const struct vec3 truth = vec3(at[0], at[1], at[2]), found = rig->lamps[i].position_mm;
        worst =
            MAX(worst, DEG * atan2(vec3_length(vec3_cross(truth, found)), vec3_dot(truth, found)));
    }
    return worst;
}

static void test_fixed_lamps(void) {
    g_autofree char *to = g_build_filename(folder, "rig.calibration", NULL);
    g_autoptr(GError) error = NULL;

    calibrate(to);
    g_autofree char *more = g_strdup_printf(" -c %s", to);
    g_autofree char *session = capture("weave", "fixed_lamps", NULL, FALSE,
                                       CONF("50", "2.2", "16", "rings=15:4;35:4;55:4;75:4",
                                            "devices=all", "exposures_us=4000;16000"),
                                       more);
    g_autofree char *world_path = g_build_filename(folder, "weave", "world.conf", NULL);
    g_autoptr(World) world = world_get(world_path, &error);
    g_assert_no_error(error);
    g_autoptr(Calibration) found = calibration_read(to, &error);
    g_assert_no_error(error);
    const double lamp_deg = worst_lamp_deg(&found->rig, world);
    g_free(process_mesorig(0, "process %s", session));
    const struct errors calibrated = btf_errors(session, world_path, 16, 4);
    g_free(process_mesorig(0, "process %s -c nominal", session));
    const struct errors nominal = btf_errors(session, world_path, 16, 4);
    g_test_message(
        "fixed lamps: worst lamp %.3f° off; BTF %.2f %% / %.1f %% (95th percentile) of the "
        "truth calibrated, %.1f %% / %.1f %% by the rig file",
        lamp_deg, calibrated.median, calibrated.p95, nominal.median, nominal.p95);
    g_assert_cmpfloat(lamp_deg, <, 0.2);
    g_assert_cmpfloat(calibrated.median, <, 2);
    g_assert_cmpfloat(calibrated.median, <, 0.7 * nominal.median);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    folder = g_dir_make_tmp("mesorig-shapes-XXXXXX", NULL);
    g_test_add_func("/shapes/dome", test_dome);
    g_test_add_func("/shapes/fixed-lamps", test_fixed_lamps);
    const int code = g_test_run();
    remove_tree(folder);
    g_free(folder);
    return code;
}
