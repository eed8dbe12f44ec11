/* The axis of a camera arm from the poses of its stops, which are computed here with quaternions:
 * about a direction a by an angle b, (cos b/2, a sin b/2). */
#include "geometry/swing.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <math.h>

#define RAD(deg) ((deg) * (G_PI / 180))

/* q v q* */
static struct vec3 about(struct vec3 axis, double angle, struct vec3 v) {
    const double w = cos(angle / 2);
    const struct vec3 u = vec3_scale(axis, sin(angle / 2));
    const struct vec3 t = vec3_scale(vec3_cross(u, v), 2);
    return vec3_add(v, vec3_add(vec3_scale(t, w), vec3_cross(u, t)));
}

static const double stops_deg[] = {-10, 0, 25, 60};

/* Two cameras at four stops each about an axis that is not where it was meant to be. noise: of
 * their poses, mm and rad. */
static struct rig rig_about(struct vec3 axis, struct vec3 centre, double zero_rad, double noise,
                            GRand *rand) {
    struct rig rig = {.n_cameras = 8};

    for (int c = 0; c < 8; c++) {
        struct rig_camera *camera = &rig.cameras[c];
        const double angle = RAD(stops_deg[c % 4]) + zero_rad;
        const struct vec3 from = c < 4 ? vec3(150, 20, 600) : vec3(300, -30, 500);
        struct vec3 eye = vec3_add(centre, about(axis, angle, vec3_sub(from, centre)));
        struct vec3 to = vec3_add(centre, about(axis, angle, vec3_sub(vec3(0, 0, 0), centre)));
        const struct vec3 off =
            vec3(g_rand_double_range(rand, -1, 1), g_rand_double_range(rand, -1, 1),
                 g_rand_double_range(rand, -1, 1));
        eye = vec3_add(eye, vec3_scale(off, noise));
        /* Its own up turns with it. */
        const struct vec3 forward = vec3_unit(vec3_sub(to, eye));
        struct vec3 right = about(axis, angle, vec3(0, 1, 0));
        right = vec3_unit(vec3_sub(right, vec3_scale(forward, vec3_dot(right, forward))));
        const struct vec3 down = vec3_cross(forward, right);
        camera->rotation = (struct mat3){{{right.x, right.y, right.z},
                                          {down.x, down.y, down.z},
                                          {forward.x, forward.y, forward.z}}};
        camera->translation_mm = vec3_scale(mat3_mul_vec(&camera->rotation, eye), -1);
        camera->on_arm = TRUE;
        camera->arm_deg = stops_deg[c % 4];
        camera->stop = c % 4;
    }
    rig.arm.axis = axis;
    rig.arm.centre_mm = centre;
    return rig;
}

TEST(moves) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    const struct vec3 axis = vec3_unit(vec3(0.1, 1, -0.2)), centre = vec3(3, -2, 1);
    const struct rig rig = rig_about(axis, centre, 0, 0, rand);

    for (int c = 0; c < 8; c++) {
        struct rig_camera moved = rig.cameras[c - c % 4];
        rig_swing_camera(&rig.arm, RAD(stops_deg[c % 4] - stops_deg[0]), &moved);
        g_assert_cmpfloat(vec3_length(vec3_sub(rig_camera_centre_mm(&moved),
                                               rig_camera_centre_mm(&rig.cameras[c]))),
                          <, 1e-9);
        for (int i = 0; i < 9; i++)
            g_assert_cmpfloat_with_epsilon(moved.rotation.m[i / 3][i % 3],
                                           rig.cameras[c].rotation.m[i / 3][i % 3], 1e-12);
    }
    g_assert_cmpfloat(rig_arm_deg(&rig, (struct camera_set){{1u << 2 | 1u << 6}}), ==, 25);
    g_assert_cmpfloat(rig_arm_deg(&rig, (struct camera_set){{0}}), ==, -10); /* the first stop */
}

TEST(fit) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(2);
    const struct vec3 meant = vec3(0, 1, 0), axis = vec3_unit(vec3(0.002, 1, -0.003));
    const struct vec3 centre = vec3(0.4, 0, -0.3);
    const struct rig nominal = rig_about(meant, vec3(0, 0, 0), 0, 0, rand);
    const struct rig exact = rig_about(axis, centre, RAD(0.3), 0, rand);
    struct rig_swing_fit fit;

    g_assert_true(rig_swing_fit(&exact, (struct camera_set){{0xff}}, &nominal, &fit));
    g_assert_cmpint(fit.n_pairs, ==, 12);
    g_assert_cmpfloat(vec3_length(vec3_sub(fit.swing.axis, axis)), <, 1e-9);
    const struct vec3 off = vec3_sub(fit.swing.centre_mm, centre);
    g_assert_cmpfloat(vec3_length(vec3_cross(off, axis)), <, 1e-6);
    g_assert_cmpfloat(fit.angle_rms_rad, <, 1e-9);
    g_assert_cmpfloat(fit.position_rms_mm, <, 1e-6);
    /* the zero is 0.3°, less what the shift of the axis itself turns the cameras by */
    g_assert_cmpfloat_with_epsilon(fit.zero_rad, RAD(0.3), RAD(0.05));

    /* Positions off by up to 0.1 mm, and directions as they then look at the middle. */
    const struct rig rough = rig_about(axis, centre, RAD(0.3), 0.1, rand);
    g_assert_true(rig_swing_fit(&rough, (struct camera_set){{0xff}}, &nominal, &fit));
    g_assert_cmpfloat(vec3_length(vec3_cross(fit.swing.axis, axis)), <, RAD(0.02));
    g_assert_cmpfloat(fit.position_rms_mm, >, 0.02);
    g_assert_cmpfloat(fit.position_rms_mm, <, 0.4);

    /* One stop of each tells nothing. */
    g_assert_false(rig_swing_fit(&exact, (struct camera_set){{1u << 1 | 1u << 6}}, &nominal, &fit));
    g_assert_true(rig_swing_fit(&exact, (struct camera_set){{1u << 1 | 1u << 3}}, &nominal, &fit));
    g_assert_cmpint(fit.n_pairs, ==, 1);
}

TEST(text) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(3);
    g_autoptr(GError) error = NULL;
    struct rig rig = rig_about(vec3(0, 1, 0), vec3(1, 2, 3), 0, 0, rand), back;

    g_strlcpy(rig.id, "arm", sizeof rig.id);
    for (int c = 0; c < 8; c++) {
        rig.cameras[c].width = rig.cameras[c].height = 10;
        rig.cameras[c].fx_px = rig.cameras[c].fy_px = rig.cameras[c].response = 1;
        g_snprintf(rig.cameras[c].name, RIG_NAME, "c%d@%g", c / 4, rig.cameras[c].arm_deg);
    }
    g_autofree char *text = rig_to_text(&rig);
    g_assert_true(ok(rig_from_text(&back, text, "c", ERR)));
    g_assert_cmpmem(&back, sizeof back, &rig, sizeof rig);
    rig.cameras[4].stop = 7; /* of a camera that has not so many */
    g_autofree char *bad = rig_to_text(&rig);
    g_assert_false(rig_from_text(&back, bad, "c", &error));
    g_assert_error(error, RIG_ERROR, RIG_ERROR_VALUE);
}
