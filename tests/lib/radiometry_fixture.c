#include "radiometry_fixture.h"

char *radiometry_fixture_world(const char *world_keys, const char *objects) {
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "[world]\nsupersample=2\ngather_rays=0\nwarm_up_s=0\n%s\n%s\n",
                           world_keys, objects);
    for (gsize i = 0; i < G_N_ELEMENTS(fixture_cameras); i++) {
        const struct fixture_camera *c = &fixture_cameras[i];
        g_string_append_printf(text,
                               "[camera cam%d]\ntheta_deg=%g\nphi_deg=%g\ndistance_mm=650\n"
                               "width=%d\nheight=%d\nfocal_px=832\nresponse=%g\ncolour=%g;%g;%g\n"
                               "vignetting=%g\nblack_level=64\nread_noise_e=4\nfull_well_e=15000\n",
                               (int)i, c->theta_deg, c->phi_deg, FIXTURE_SIZE, FIXTURE_SIZE,
                               c->response, c->colour[0], c->colour[1], c->colour[2],
                               c->vignetting);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(fixture_lamps); i++) {
        const struct fixture_lamp *l = &fixture_lamps[i];
        g_string_append_printf(text,
                               "[lamp lamp%d]\ntheta_deg=%g\ndistance_mm=500\nintensity=%g\n"
                               "exponent=%g\naim_deg=%g;%g\n",
                               (int)i, l->theta_deg, l->intensity, l->exponent, l->aim_deg[0],
                               l->aim_deg[1]);
    }
    return g_string_free(text, FALSE);
}

void radiometry_fixture_rig(struct rig *rig) {
    *rig = (struct rig){.id = "small",
                        .n_cameras = G_N_ELEMENTS(fixture_cameras),
                        .n_lamps = G_N_ELEMENTS(fixture_lamps)};
    for (int i = 0; i < rig->n_cameras; i++) {
        struct rig_camera *c = &rig->cameras[i];
        g_snprintf(c->name, sizeof c->name, "cam%d", i);
        c->width = c->height = FIXTURE_SIZE;
        c->fx_px = c->fy_px = 832;
        c->cx_px = c->cy_px = (FIXTURE_SIZE - 1) / 2.0;
        c->response = 6000;
        struct vec3 out = rig_direction(fixture_cameras[i].theta_deg * G_PI / 180,
                                        fixture_cameras[i].phi_deg * G_PI / 180);
        rig_camera_look_at(c, vec3_scale(out, 650), vec3(0, 0, 0));
    }
    for (int i = 0; i < rig->n_lamps; i++) {
        struct rig_lamp *l = &rig->lamps[i];
        struct vec3 out = rig_direction(fixture_lamps[i].theta_deg * G_PI / 180, 0);
        g_snprintf(l->name, sizeof l->name, "lamp%d", i);
        l->position_mm = vec3_scale(out, 500);
        l->aim = vec3_scale(out, -1);
        l->exponent = 2;
        l->intensity = 40;
    }
}

struct vec3 radiometry_fixture_aim(int lamp) {
    double theta = fixture_lamps[lamp].theta_deg * G_PI / 180;
    double along = tan(fixture_lamps[lamp].aim_deg[0] * G_PI / 180);
    double across = tan(fixture_lamps[lamp].aim_deg[1] * G_PI / 180);
    return vec3_unit(
        vec3(-sin(theta) - along * cos(theta), across, -cos(theta) + along * sin(theta)));
}

void radiometry_fixture_expose(World *world, int camera, const struct fixture_pose *pose,
                               gint64 exposure_us, guint64 key, float *ret) {
    guint16 pixels[FIXTURE_SIZE * FIXTURE_SIZE];
    gint64 at_us = (gint64)(pose->time_s * 1e6);
    struct world_state state;
    world_set_turntable(world, pose->turntable_deg);
    world_set_arc(world, pose->arc_deg);
    if (pose->lamp >= 0)
        world_set_lamp(world, pose->lamp, TRUE, at_us);
    world_snapshot(world, at_us + G_USEC_PER_SEC, exposure_us, &state);
    if (pose->lamp >= 0)
        world_set_lamp(world, pose->lamp, FALSE, at_us + 2 * G_USEC_PER_SEC);
    world_expose(world, camera, &state, exposure_us, 0, key, pixels);
    for (int i = 0; i < FIXTURE_SIZE * FIXTURE_SIZE; i++)
        ret[i] = pixels[i];
}

void radiometry_fixture_mosaic(World *world, int camera, const struct fixture_pose *pose, int n,
                               guint64 key, float *ret) {
    float one[FIXTURE_SIZE * FIXTURE_SIZE];
    for (int i = 0; i < FIXTURE_SIZE * FIXTURE_SIZE; i++)
        ret[i] = 0;
    for (int k = 0; k < n; k++) {
        radiometry_fixture_expose(world, camera, pose, FIXTURE_US, key * 64 + (guint64)k, one);
        for (int i = 0; i < FIXTURE_SIZE * FIXTURE_SIZE; i++)
            ret[i] += (one[i] - 64) / ((float)n * FIXTURE_US * 1e-3f);
    }
}
