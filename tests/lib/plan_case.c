#include "lib/plan_case.h"
#include "lib/ok.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static const char *const head = "[session]\nname = test\n"
                                "[sample]\nwidth_mm = 50\nheight_mm = 50\ntexels = 64\n"
                                "reference_mm = 5\ndepth_mm = 5\n";
static const char *const tail = "[capture]\nexposures_us = 4000; 16000\n";

struct session_conf plan_case_conf(const char *directions) {
    g_autofree char *text = g_strconcat(head, directions, tail, NULL);
    struct session_conf conf;

    g_assert_true(ok(session_conf_parse(&conf, text, "test.conf", ERR)));
    return conf;
}

struct rig plan_case_rig(const double *theta_deg, int n) {
    struct rig rig = {.id = "test",
                      .n_cameras = n,
                      .n_lamps = n,
                      .n_lasers = n,
                      .arc_radius_mm = 500,
                      .arc_width_mm = 30};

    for (int i = 0; i < n; i++) {
        double s = sin(RAD(theta_deg[i])), c = cos(RAD(theta_deg[i]));
        rig.cameras[i] = (struct rig_camera){.width = 160, .height = 160, .fx_px = 1664};
        g_snprintf(rig.cameras[i].name, RIG_NAME, "cam%g", theta_deg[i]);
        g_snprintf(rig.lamps[i].name, RIG_NAME, "lamp%g", theta_deg[i]);
        g_snprintf(rig.lasers[i].name, RIG_NAME, "laser%g", theta_deg[i]);
        rig_camera_look_at(&rig.cameras[i], vec3(650 * s, 0, 650 * c), vec3(0, 0, 0));
        rig.lamps[i].position_mm = vec3(500 * s, 0, 500 * c);
        rig.lamps[i].aim = vec3(-s, 0, -c);
        rig.lasers[i].position_mm = vec3(480 * s, 0, 480 * c);
        rig.lasers[i].axis = vec3(0, 1, 0);
        rig.lasers[i].normal = vec3(-c, 0, s); /* y × (−s, 0, −c) */
    }
    return rig;
}

struct rig_timing plan_case_timing(double warm_up_s) {
    struct rig_timing t = {
        .turntable = {0, 360, TRUE, 60, 120, 0.05, 150},
        .arc = {0, 360, TRUE, 45, 60, 0.1, 200},
    };

    for (int i = 0; i < RIG_MAX_LAMPS; i++)
        t.lamp_warm_up_s[i] = warm_up_s;
    for (int i = 0; i < RIG_MAX_LASERS; i++) {
        t.sweep[i] = (struct axis_motion){-15, 15, FALSE, 30, 400, 0, 10};
        t.laser_warm_up_s[i] = 0.1;
    }
    for (int i = 0; i < RIG_MAX_CAMERAS; i++) {
        t.readout_us[i] = 40000;
        t.min_exposure_us[i] = 10;
        t.max_exposure_us[i] = 10000000;
        t.bits[i] = 12;
    }
    return t;
}

struct plan *plan_case_build(const struct session_conf *conf, const struct rig *rig,
                             const struct rig_timing *timing) {
    struct plan *plan = ok(plan_build(conf, rig, timing, ERR));
    g_assert_nonnull(plan);
    return plan;
}

void plan_case_refused(const struct session_conf *conf, const struct rig *rig,
                       const struct rig_timing *timing, int code, const char *says) {
    g_autoptr(GError) error = NULL;

    g_assert_null(plan_build(conf, rig, timing, &error));
    g_assert_error(error, PLAN_ERROR, code);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, says));
}
