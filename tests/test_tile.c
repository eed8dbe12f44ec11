/* From a white tile to reflectances of a grey scale, through sessions; and what marks notice. */
#include "processing/btf.h"
#include "processing/pipeline.h"
#include "processing/tile_session.h"
#include "radiometry_rig.h"

static const struct tile_options white = {.reflectance = {0.96, 0.96, 0.96}};

static char *new_folder(void) {
    char *folder = g_dir_make_tmp("mesorig-tile-XXXXXX", NULL);
    g_autofree char *rig = rig_text("");
    rig_write(folder, "rig.conf", rig);
    return folder;
}

/* Captures the tile and writes calibration.conf. */
static void calibrate(const char *folder, int seed, struct tile_result *ret) {
    g_autoptr(GError) error = NULL;
    rig_write_tile(folder, seed);
    enum capture_state state = rig_capture(folder, TILE_CONF, "tile", NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(state, ==, CAPTURE_DONE);
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autoptr(Calibration) calibration = calibration_from_text(text, path, &error);
    g_assert_no_error(error);
    /* Geometry is right as it is said in the rig file. */
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "nominal", 0, "-", NULL);
    gboolean ok = tile_session(session, calibration, &white, ret, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    g_autofree char *to = g_build_filename(folder, "calibration.conf", NULL);
    g_assert_true(calibration_write(calibration, to, &error));
}

static void tile(void) {
    g_autofree char *folder = new_folder();
    struct tile_result result;
    calibrate(folder, 1, &result);
    g_test_message("%d pictures, %d cells, residual %.4f, quality %.3f, drift %.4f, %d marks, %d "
                   "cameras' noise",
                   result.pictures, result.cells, result.residual, result.quality, result.drift,
                   result.marks, result.transfers);
    rig_remove(folder);
}

/* Four greys beside each other, in a session of their own, and what the world says they are. */
static const double greys[] = {0.1, 0.2, 0.45, 0.85};
static const double grey_mm[][2] = {{-12, 12}, {12, 12}, {-12, -12}, {12, -12}};

#define GREY_CONF                                                                                  \
    "[session]\nname=grey\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=32\nreference_mm=4\n"       \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:4; 45:4; 70:4\n"           \
    "offset_deg=50\n[capture]\nexposures_us=2000;6000\ndark_frames=4\n"

static void write_greys(const char *folder, int seed, const char *world_keys) {
    g_autofree char *keys =
        g_strdup_printf("seed=%d\nturntable_albedo=0.02\n%s", seed + 100, world_keys);
    g_autoptr(GString) objects =
        g_string_new("[sample]\nkind=flat\nwidth_mm=48\nheight_mm=48\nbase_mm=1\nalbedo=0.03\n");
    for (gsize i = 0; i < G_N_ELEMENTS(greys); i++)
        g_string_append_printf(objects,
                               "[mark g%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=9\nalbedo=%g\n",
                               (int)i, grey_mm[i][0], grey_mm[i][1], greys[i]);
    rig_write_world(folder, keys, objects->str);
}

/* A grey's reflectance over all views and lights: BTF values hold n·l, which lamps' true places
 * tell. */
static double measure_grey(Session *session, int grey, const struct session_grid *grid) {
    g_autoptr(GPtrArray) views = session_views(session, NULL);
    g_autoptr(GPtrArray) lights = session_lights(session, NULL);
    g_autofree int *all = g_new(int, lights->len);
    g_autofree float *rgb = g_new(float, (gsize)grid->width *(gsize)grid->height * 3 * lights->len);
    double seen = 0, expected = 0;
    for (guint l = 0; l < lights->len; l++)
        all[l] = (int)l;
    for (guint v = 0; v < views->len; v++) {
        g_autofree char *name = g_strdup_printf("products/btf/view_%04u.exr", v);
        g_autofree char *path = session_file(session, name);
        g_assert_true(btf_read_view(path, all, (int)lights->len, grid, rgb, NULL));
        for (guint l = 0; l < lights->len; l++) {
            const struct session_direction *light = lights->pdata[l];
            struct vec3 lamp = vec3_scale(
                rig_direction(light->theta_deg * G_PI / 180, light->phi_deg * G_PI / 180), 500);
            for (int t = 0; t < grid->width * grid->height; t++) {
                struct vec3 p =
                    rectify_point_mm(grid, t % grid->width + 0.5, t / grid->width + 0.5);
                if (hypot(p.x - grey_mm[grey][0], p.y - grey_mm[grey][1]) > 1.8)
                    continue;
                struct vec3 way = vec3_sub(lamp, p);
                const float *at =
                    rgb + ((gsize)l * (gsize)(grid->width * grid->height) + (gsize)t) * 3;
                for (int k = 0; k < 3; k++) {
                    seen += at[k];
                    expected += way.z / vec3_length(way);
                }
            }
        }
    }
    return seen / expected;
}

/* A held grey scale: 3 % of drift, 20 % of vignetting, everything nominal wrong. */
static double grey_error(int seed) {
    g_autofree char *folder = new_folder();
    g_autoptr(GError) error = NULL;
    struct tile_result result;
    struct pipeline_options options = {.n_threads = 2};
    struct pipeline_result made;
    struct session_grid grid;
    double worst = 0;
    calibrate(folder, seed, &result);
    write_greys(folder, seed, "drift_pct=3\ndrift_period_s=170");
    enum capture_state state = rig_capture(folder, GREY_CONF, "grey", NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(state, ==, CAPTURE_DONE);
    g_autofree char *path = g_build_filename(folder, "grey.session", NULL);
    gboolean ok = pipeline_run(path, &options, &made, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_true(session_grid(session, &grid, &error));
    for (int i = 0; i < (int)G_N_ELEMENTS(greys); i++) {
        double found = measure_grey(session, i, &grid);
        g_test_message("seed %d: grey %.3f measured %.4f, %+.3f %%", seed, greys[i], found,
                       100 * (found / greys[i] - 1));
        worst = MAX(worst, fabs(found / greys[i] - 1));
    }
    g_clear_pointer(&session, session_close);
    rig_remove(folder);
    return worst;
}

static void grey_scale(void) {
    for (int seed = 1; seed <= 2; seed++)
        g_assert_cmpfloat(grey_error(seed), <, 0.005);
}

/* The truth as a calibration, with cameras calibrated days ago. */
static void write_truth(const char *folder, const char *id, int days) {
    g_autofree char *rig_path = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *path = g_build_filename(folder, "calibration.conf", NULL);
    g_autoptr(GError) error = NULL;
    struct rig rig;
    g_assert_true(devices_read_geometry(rig_path, &rig, &error));
    g_strlcpy(rig.id, id, sizeof rig.id);
    for (int i = 0; i < 3; i++) {
        rig.cameras[i].response = fixture_cameras[i].response;
        rig.lamps[i].intensity = fixture_lamps[i].intensity;
    }
    for (int i = 0; i < rig.n_marks; i++)
        rig.marks[i].centre_mm = vec3(rig_marks_mm[i][0], rig_marks_mm[i][1], 4);
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    struct calibration_part *part =
        calibration_set_part(calibration, CALIBRATION_CAMERAS, "truth", 0, "-", NULL);
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autoptr(GDateTime) then = g_date_time_add_days(now, -days);
    g_free(part->date);
    part->date = g_date_time_format(then, "%Y-%m-%dT%H:%M:%SZ");
    g_assert_true(calibration_write(calibration, path, &error));
}

#define FEW_CONF                                                                                   \
    "[session]\nname=few\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=8\nreference_mm=4\n"         \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:2; 45:2\n"                 \
    "offset_deg=50\n[capture]\nexposures_us=4000\ndark_frames=2\n"

/* What a session says of a rig in which something may have moved. */
static char *pause_of(const char *world_keys, const char *turntable_keys,
                      enum capture_state expected) {
    g_autofree char *folder = new_folder(), *reason = NULL;
    g_autofree char *rig = rig_text(turntable_keys);
    g_autoptr(GString) told = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    rig_write(folder, "rig.conf", rig);
    write_truth(folder, "radiometry", 1);
    write_greys(folder, 1, "");
    if (world_keys) { /* of the second camera */
        g_autofree char *path = g_build_filename(folder, "world.conf", NULL), *text = NULL;
        g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
        g_auto(GStrv) parts = g_strsplit(text, "[camera cam1]\n", 2);
        g_autofree char *changed =
            g_strconcat(parts[0], "[camera cam1]\n", world_keys, "\n", parts[1], NULL);
        rig_write(folder, "world.conf", changed);
    }
    enum capture_state state = rig_capture(folder, FEW_CONF, "few", told, &reason, &error);
    g_assert_no_error(error);
    g_test_message("%s%s: %s", world_keys ? world_keys : "", turntable_keys,
                   reason ? reason : told->str);
    g_assert_cmpint(state, ==, expected);
    rig_remove(folder);
    return g_strdup(reason ? reason : told->str);
}

static void quick_check(void) {
    g_autofree char *nothing = pause_of(NULL, "", CAPTURE_DONE);
    g_assert_nonnull(strstr(nothing, "quick check"));
    g_autofree char *camera = pause_of("turn_deg=0;0.1;0", "", CAPTURE_PAUSED);
    g_assert_nonnull(strstr(camera, "camera cam1 is turned by 0.1"));
    g_assert_null(strstr(camera, "cam0"));
    g_autofree char *slip = pause_of(NULL, "fault_slip_deg=0.1\n", CAPTURE_PAUSED);
    g_assert_nonnull(strstr(slip, "turntable has slipped by +0."));
    g_autofree char *later =
        pause_of(NULL, "fault_slip_deg=-0.2\nfault_slip_at=2\n", CAPTURE_PAUSED);
    g_assert_nonnull(strstr(later, "turntable has slipped by -0."));
}

/* Old calibrations are warned of, other rigs' and damaged ones refused. */
static void policy(void) {
    g_autofree char *folder = new_folder();
    g_autofree char *path = g_build_filename(folder, "calibration.conf", NULL), *text = NULL;
    g_autoptr(GString) told = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    write_greys(folder, 1, "");
    g_assert_cmpint(rig_capture(folder, FEW_CONF, "none", told, NULL, &error), ==, CAPTURE_DONE);
    g_assert_nonnull(strstr(told->str, "is not there yet"));
    write_truth(folder, "radiometry", 40);
    g_string_truncate(told, 0);
    g_assert_cmpint(rig_capture(folder, FEW_CONF, "old", told, NULL, &error), ==, CAPTURE_DONE);
    g_assert_no_error(error);
    g_assert_nonnull(strstr(told->str, "calibration of cameras"));
    g_assert_nonnull(strstr(told->str, "40 days old"));
    write_truth(folder, "another", 1);
    g_assert_cmpint(rig_capture(folder, FEW_CONF, "other", told, NULL, &error), ==,
                    CAPTURE_ABORTED);
    g_assert_error(error, RIG_ERROR, RIG_ERROR_VALUE);
    g_assert_nonnull(strstr(error->message, "another"));
    g_clear_error(&error);
    write_truth(folder, "radiometry", 1);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    text[strlen(text) / 2] = '\0';
    rig_write(folder, "calibration.conf", text);
    g_assert_cmpint(rig_capture(folder, FEW_CONF, "cut", told, NULL, &error), ==, CAPTURE_ABORTED);
    g_assert_nonnull(strstr(error->message, "calibration.conf"));
    g_autofree char *session = g_build_filename(folder, "cut.session", NULL);
    g_assert_false(g_file_test(session, G_FILE_TEST_EXISTS));
    rig_remove(folder);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/tile/tile", tile);
    g_test_add_func("/tile/grey-scale", grey_scale);
    g_test_add_func("/tile/quick-check", quick_check);
    g_test_add_func("/tile/policy", policy);
    int status = g_test_run();
    fixture_clean();
    return status;
}
