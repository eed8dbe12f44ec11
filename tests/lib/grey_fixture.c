#include "grey_fixture.h"
#include "lib/ok.h"

char *grey_folder(void) {
    char *folder = g_dir_make_tmp("mesorig-tile-XXXXXX", NULL);
    g_autofree char *rig = radiometry_rig_text("");
    radiometry_rig_write(folder, "rig.conf", rig);
    return folder;
}

void grey_calibrate(const char *folder, int seed, struct tile_result *ret) {
    g_autoptr(GError) error = NULL;
    radiometry_rig_write_tile(folder, seed);
    enum capture_state state =
        ok(radiometry_rig_capture(folder, TILE_CONF, "tile", NULL, NULL, ERR));
    g_assert_cmpint(state, ==, CAPTURE_DONE);
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autoptr(Calibration) calibration = calibration_from_text(text, path, &error);
    g_assert_no_error(error);
    /* The geometry of the rig file is correct. */
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "nominal", 0, "-", NULL);
    gboolean ok = ok(tile_session(session, calibration, &grey_tile, ret, ERR));
    g_assert_true(ok);
    g_autofree char *to = g_build_filename(folder, "calibration.conf", NULL);
    g_assert_true(calibration_write(calibration, to, &error));
}

void grey_write(const char *folder, int seed, const char *world_keys) {
    g_autofree char *keys =
        g_strdup_printf("seed=%d\nturntable_albedo=0.02\n%s", seed + 100, world_keys);
    g_autoptr(GString) objects =
        g_string_new("[sample]\nkind=flat\nwidth_mm=48\nheight_mm=48\nbase_mm=1\nalbedo=0.03\n");
    for (gsize i = 0; i < G_N_ELEMENTS(grey_values); i++)
        g_string_append_printf(objects,
                               "[mark g%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=9\nalbedo=%g\n",
                               (int)i, grey_mm[i][0], grey_mm[i][1], grey_values[i]);
    radiometry_rig_write_world(folder, keys, objects->str);
}

/* Returns the reflectance of a grey patch over all views and lights. BTF values contain n·l, which
 * is computed from the true positions of the lamps. */
static double grey_measure(Session *session, int grey, const struct session_grid *grid) {
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
        g_assert_true(btf_read_view(path, all, (int)lights->len, grid, 0, rgb, NULL));
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

double grey_error(int seed, gboolean calibrated) {
    g_autofree char *folder = grey_folder();
    g_autoptr(GError) error = NULL;
    struct tile_result result;
    struct pipeline_options options = {.work.n_threads = 2};
    struct pipeline_result made;
    struct session_grid grid;
    double worst = 0;
    if (calibrated)
        grey_calibrate(folder, seed, &result);
    grey_write(folder, seed, "drift_pct=3\ndrift_period_s=170");
    enum capture_state state =
        ok(radiometry_rig_capture(folder, GREY_CONF, "grey", NULL, NULL, ERR));
    g_assert_cmpint(state, ==, CAPTURE_DONE);
    g_autofree char *path = g_build_filename(folder, "grey.session", NULL);
    gboolean ok = ok(pipeline_run(path, &options, &made, ERR));
    g_assert_true(ok);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_true(session_grid(session, &grid, &error));
    for (int i = 0; i < (int)G_N_ELEMENTS(grey_values); i++) {
        double found = grey_measure(session, i, &grid);
        if (g_test_initialized())
            g_test_message("seed %d: grey %.3f measured %.4f, %+.3f %%", seed, grey_values[i],
                           found, 100 * (found / grey_values[i] - 1));
        worst = MAX(worst, fabs(found / grey_values[i] - 1));
    }
    g_clear_pointer(&session, session_close);
    radiometry_rig_remove(folder);
    return worst;
}

void grey_truth(const char *folder, const char *id, int days) {
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
    for (int i = 0; i < rig.n_fiducials; i++)
        rig.fiducials[i].centre_mm = vec3(rig_marks_mm[i][0], rig_marks_mm[i][1], 4);
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    struct calibration_part *part =
        calibration_set_part(calibration, CALIBRATION_CAMERAS, "truth", 0, "-", NULL);
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autoptr(GDateTime) then = g_date_time_add_days(now, -days);
    g_free(part->date);
    part->date = g_date_time_format(then, "%Y-%m-%dT%H:%M:%SZ");
    g_assert_true(calibration_write(calibration, path, &error));
}

char *grey_pause(int seed, const char *world_keys, const char *turntable_keys,
                 enum capture_state *ret_state) {
    g_autofree char *folder = grey_folder(), *reason = NULL;
    g_autofree char *rig = radiometry_rig_text(turntable_keys);
    g_autoptr(GString) told = g_string_new(NULL);
    radiometry_rig_write(folder, "rig.conf", rig);
    grey_truth(folder, "radiometry", 1);
    grey_write(folder, seed, "");
    if (world_keys) { /* the keys belong to the second camera */
        g_autofree char *path = g_build_filename(folder, "world.conf", NULL), *text = NULL;
        g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
        g_auto(GStrv) parts = g_strsplit(text, "[camera cam1]\n", 2);
        g_autofree char *changed =
            g_strconcat(parts[0], "[camera cam1]\n", world_keys, "\n", parts[1], NULL);
        radiometry_rig_write(folder, "world.conf", changed);
    }
    enum capture_state state =
        ok(radiometry_rig_capture(folder, GREY_FEW_CONF, "few", told, &reason, ERR));
    if (g_test_initialized())
        g_test_message("%s%s: %s", world_keys ? world_keys : "", turntable_keys,
                       reason ? reason : told->str);
    *ret_state = state;
    radiometry_rig_remove(folder);
    return g_strdup(reason ? reason : told->str);
}

static void grey_add(struct grey_chi2 *to, double found, double truth, double error) {
    to->sum += (found - truth) * (found - truth) / (error * error);
    to->n++;
}

/* Returns the logarithm of a camera's gain in a colour, relative to the geometric mean of the
 * cameras. */
static double grey_log_gain(int camera, int colour) {
    double own = 0, mean = 0;
    for (int c = 0; c < 3; c++) {
        double gain = log(fixture_cameras[c].response * fixture_cameras[c].colour[colour] / 6000);
        mean += gain / 3;
        own = c == camera ? gain : own;
    }
    return own - mean;
}

void grey_compare(const struct calibration *found, struct grey_chi2 *to) {
    for (int c = 0; c < 3; c++) {
        const struct radiometry_camera *r = &found->camera_radiometry[c];
        const struct transfer *t = &found->noise[c].transfer;
        double mean = 0;
        for (int k = 0; k < 3; k++)
            mean += grey_log_gain(c, k) / 3;
        grey_add(to, log(found->rig.cameras[c].response / 6000), mean, r->response_error);
        for (int k = 0; k < 3; k++)
            grey_add(to, r->colour[k], exp(grey_log_gain(c, k) - mean), r->colour_error[k]);
        grey_add(to, found->rig.lamps[c].exponent, fixture_lamps[c].exponent,
                 found->lamp_radiometry[c].exponent_error);
        grey_add(to, t->black_dn, 64, t->black_error_dn);
        grey_add(to, t->gain_dn_e, (4095.0 - 64) / 15000, t->gain_error_dn_e);
        grey_add(to, t->read_noise_e, 4, t->read_noise_error_e);
        grey_add(to, t->curvature, 0, t->curvature_error);
    }
    for (int m = 0; m < found->rig.n_fiducials; m++) {
        const struct rig_fiducial *mark = &found->rig.fiducials[m];
        grey_add(to, mark->centre_mm.x, rig_marks_mm[m][0], found->fiducials[m].centre_mm[0]);
        grey_add(to, mark->centre_mm.y, rig_marks_mm[m][1], found->fiducials[m].centre_mm[1]);
        grey_add(to, mark->centre_mm.z, 4, found->fiducials[m].centre_mm[2]);
        grey_add(to, mark->reflectance[1], 0.9, found->fiducials[m].reflectance[1]);
    }
}
