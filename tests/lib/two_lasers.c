#include "two_lasers.h"

World *two_lasers_world(int side, double power_w, const char *world, const char *sample) {
    g_autofree char *text = g_strdup_printf(
        "[world]\nseed = 7\nnoise = yes\nsupersample = 2\ngather_rays = 6\nwarm_up_s = 0\n%s"
        "[sample]\nseed = 3\nbase_mm = 0.8\n%s"
        "[camera cam]\ntheta_deg = 40\ndistance_mm = 650\nwidth = %d\nheight = %d\nfocal_px = %d\n"
        "response = 6000\n"
        "[laser first]\ntheta_deg = 30\ndistance_mm = 480\nwidth_mm = 1.2\nfan_deg = 20\n"
        "power_w = %.3f\n"
        "[laser second]\ntheta_deg = 60\ndistance_mm = 480\nwidth_mm = 1.2\nfan_deg = 20\n"
        "power_w = %.3f\n",
        world, sample, side, side, TWO_LASERS_FOCAL_PX, power_w, power_w);
    return world_fixture_new(text);
}

struct rig two_lasers_rig(int side) {
    const double degree = G_PI / 180;
    struct rig rig = {.n_cameras = 1, .n_lasers = 2};
    rig.cameras[0] = (struct rig_camera){.width = side,
                                         .height = side,
                                         .fx_px = TWO_LASERS_FOCAL_PX,
                                         .fy_px = TWO_LASERS_FOCAL_PX,
                                         .cx_px = (side - 1) / 2.0,
                                         .cy_px = (side - 1) / 2.0,
                                         .response = 6000};
    rig_camera_look_at(&rig.cameras[0], vec3_scale(rig_direction(40 * degree, 0), 650),
                       vec3(0, 0, 0));
    for (int i = 0; i < 2; i++) {
        const struct vec3 out = rig_direction((30 + 30 * i) * degree, 0);
        rig.lasers[i] =
            (struct rig_laser){.position_mm = vec3_scale(out, 480),
                               .axis = vec3(0, 1, 0),
                               .normal = vec3_cross(vec3(0, 1, 0), vec3_scale(out, -1))};
    }
    return rig;
}
