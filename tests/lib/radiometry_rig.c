#include "radiometry_rig.h"
#include "lib/capture_steps.h"

#include <gio/gio.h>

static void radiometry_rig_axis(GString *text, const char *name, const char *keys) {
    g_string_append_printf(text,
                           "[axis %s]\ndriver=sim-axis\nworld=world.conf\npart=%s\nwraps=yes\n"
                           "speed_deg_s=60\naccel_deg_s2=120\nsettle_ms=20\n%s\n",
                           name, name, keys);
}

char *radiometry_rig_text(const char *turntable_keys) {
    GString *text = g_string_new("[rig]\nid=radiometry\nclock=virtual\narc_radius_mm=500\n"
                                 "arc_width_mm=30\ncalibration=calibration.conf\n");
    radiometry_rig_axis(text, "turntable", turntable_keys);
    radiometry_rig_axis(text, "arc", "");
    g_string_append(text, "[lamps bank]\ndriver=sim-lamps\nworld=world.conf\n");
    for (gsize i = 0; i < G_N_ELEMENTS(fixture_lamps); i++)
        g_string_append_printf(text,
                               "[lamp lamp%d]\nbank=bank\nindex=%d\ntheta_deg=%g\n"
                               "distance_mm=500\nexponent=2\nintensity=40\n",
                               (int)i, (int)i, fixture_lamps[i].theta_deg);
    for (gsize i = 0; i < G_N_ELEMENTS(fixture_cameras); i++)
        g_string_append_printf(text,
                               "[camera cam%d]\ndriver=sim-camera\nworld=world.conf\n"
                               "theta_deg=%g\nphi_deg=%g\ndistance_mm=650\nwidth=%d\nheight=%d\n"
                               "focal_px=832\nresponse=6000\n",
                               (int)i, fixture_cameras[i].theta_deg, fixture_cameras[i].phi_deg,
                               FIXTURE_SIZE, FIXTURE_SIZE);
    for (gsize i = 0; i < G_N_ELEMENTS(rig_marks_mm); i++)
        g_string_append_printf(
            text, "[mark m%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=3\nreflectance=0.8\n", (int)i,
            rig_marks_mm[i][0] + 0.2, rig_marks_mm[i][1] - 0.15);
    return g_string_free(text, FALSE);
}

void radiometry_rig_write(const char *folder, const char *name, const char *text) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

void radiometry_rig_write_world(const char *folder, const char *keys, const char *objects) {
    g_autoptr(GString) all = g_string_new(objects);
    for (gsize i = 0; i < G_N_ELEMENTS(rig_marks_mm); i++)
        g_string_append_printf(all,
                               "[mark m%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=3\nalbedo=0.9\n",
                               (int)i, rig_marks_mm[i][0], rig_marks_mm[i][1]);
    g_autofree char *text = radiometry_fixture_world(keys, all->str);
    radiometry_rig_write(folder, "world.conf", text);
}

void radiometry_rig_write_tile(const char *folder, int seed) {
    g_autofree char *keys = g_strdup_printf(
        "seed=%d\nturntable_albedo=0.02\ndrift_pct=3\ndrift_period_s=%d", seed, 200 + 37 * seed);
    radiometry_rig_write_world(
        folder, keys, "[sample]\nkind=flat\nwidth_mm=56\nheight_mm=56\nbase_mm=4\nalbedo=0.96\n");
}

static void radiometry_rig_on_event(Capture *capture, const char *level, const char *source,
                                    const char *message, gpointer data) {
    struct rig_told *told = data;
    g_string_append_printf(told->text, "%s %s: %s\n", level, source, message);
}

enum capture_state radiometry_rig_capture(const char *folder, const char *conf_text,
                                          const char *name, GString *told, char **ret_reason,
                                          GError **error) {
    g_autofree char *rig = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *path = g_strdup_printf("%s/%s.session", folder, name);
    struct session_conf conf = {0};
    struct rig_told to = {told};
    struct capture_callbacks callbacks = {.event = told ? radiometry_rig_on_event : NULL,
                                          .data = &to};
    struct capture_status status = {.state = CAPTURE_ABORTED};
    struct devices *devices = devices_open(rig, error);
    if (devices && session_conf_parse(&conf, conf_text, "session.conf", error)) {
        Capture *capture = capture_start(devices, &conf, path, &callbacks, error);
        while (capture) {
            capture_get_status(capture, &status);
            if (status.state >= CAPTURE_PAUSED)
                break;
            g_main_context_iteration(NULL, TRUE);
        }
        if (capture && ret_reason)
            *ret_reason = g_strdup(status.reason);
        capture_free(capture);
    }
    session_conf_clear(&conf);
    devices_close(devices);
    return status.state;
}

void radiometry_rig_remove(const char *path) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *child = g_build_filename(path, name, NULL);
        if (g_file_test(child, G_FILE_TEST_IS_DIR))
            radiometry_rig_remove(child);
        else
            g_unlink(child);
    }
    g_rmdir(path);
}
