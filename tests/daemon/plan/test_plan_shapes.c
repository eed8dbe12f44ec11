#include "lib/plan_case.h"
#include "lib/test.h"

#include <locale.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static const double demo_theta_deg[] = {15, 30, 45, 60, 75};

static struct vec3 at_mm(double theta_deg, double phi_deg, double distance_mm) {
    return vec3_scale(rig_direction(RAD(theta_deg), RAD(phi_deg)), distance_mm);
}

static void stand(struct rig *rig, double theta_deg, double phi_deg) {
    struct rig_lamp *lamp = &rig->lamps[rig->n_lamps++];

    g_snprintf(lamp->name, RIG_NAME, "led%d", rig->n_lamps);
    lamp->position_mm = at_mm(theta_deg, phi_deg, 400);
    lamp->fixed = 1;
}

/* A camera above the sample and LEDs in no order: nothing moves, and each light is one of the LEDs.
 */
TEST(dome) {
    g_auto(SessionConf) conf = plan_case_conf("[views]\ndevices=all\n[lights]\ndevices=all\n");
    struct rig rig = {.n_cameras = 1};
    struct rig_timing timing = plan_case_timing(0.25);

    rig.cameras[0] = (struct rig_camera){.name = "cam", .width = 160, .height = 160};
    rig_camera_look_at(&rig.cameras[0], vec3(0, 0, 650), vec3(0, 0, 0));
    for (int i = 0; i < RIG_MAX_LAMPS; i++)
        stand(&rig, 10 + 65.0 * i / RIG_MAX_LAMPS, fmod(137.5 * i, 360));
    timing.turntable = timing.arc = (struct axis_motion){0};
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(plan->session.n_views, ==, 1);
    g_assert_cmpint(plan->session.n_lights, ==, RIG_MAX_LAMPS);
    g_assert_cmpint(plan->session.n_shots, ==, 1 + RIG_MAX_LAMPS);
    g_assert_cmpint(plan->n_poses, ==, 1);
    for (int i = 0; i < RIG_MAX_LAMPS; i++) {
        const struct session_direction *light = &plan->session.lights[i];
        const struct session_shot *shot = &plan->session.shots[1 + i];
        const struct vec3 towards = at_mm(light->theta_deg, light->phi_deg, 400);
        g_assert_cmpint(light->device, ==, i);
        g_assert_cmpfloat(vec3_length(vec3_sub(towards, rig.lamps[i].position_mm)), <, 1e-4);
        g_assert_cmpint(shot->state, ==, SHOT_PLANNED);
        g_assert_cmpint(shot->device, ==, shot->source);
        g_assert_true(shot->turntable_deg == 0 && shot->arc_deg == 0);
    }
    /* a BTF it is not, and that is said */
    g_assert_cmpint(plan->notes->len, ==, 1);
    g_assert_nonnull(strstr(plan->notes->pdata[0], "RTI"));

    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=0:1\n[lights]\ndevices=led3; led128\n");
    g_autoptr(Plan) two = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(two->session.n_lights, ==, 2);
    g_assert_cmpint(two->session.lights[1].device, ==, 127);
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=0:1\n[lights]\ndevices=led3; led1025\n");
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_NO_LAMP, "there is no [lamp led1025]");
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=0:1\n[lights]\nrings=30:4\n");
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_NO_LAMP, "devices = all");
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=0:1\n[lasers]\ndevices=all\n");
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_NO_LASER, "there is no laser");

    /* cameras that stand around, beside some of the lamps: no other views than theirs */
    rig.n_lamps = 128;
    rig_camera_look_at(&rig.cameras[0], at_mm(40, 100, 650), vec3(0, 0, 0));
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=40:1:100.3\n[lights]\ndevices=all\n");
    g_autoptr(Plan) near = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpfloat(near->session.views[0].turntable_deg, ==, 0);
    rig.n_cameras = 2;
    rig.cameras[1] = rig.cameras[0];
    g_strlcpy(rig.cameras[1].name, "other", RIG_NAME);
    rig_camera_look_at(&rig.cameras[1], at_mm(20, 30, 650), vec3(0, 0, 0));
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\ndevices=all\n[lights]\ndevices=all\n");
    g_autoptr(Plan) still = plan_case_build(&conf, &rig, &timing);
    g_assert_true(
        g_str_has_prefix(still->notes->pdata[still->notes->len - 1], "no turntable: 2 views"));
    rig.n_cameras = 1;
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=40:2:100\n[lights]\ndevices=all\n");
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_LIMITS, "there is no [axis turntable]");
}

static struct rig four_cameras(void) {
    struct rig rig = {.n_cameras = 4};

    for (int c = 0; c < 4; c++) {
        rig.cameras[c] = (struct rig_camera){.width = 160, .height = 160};
        g_snprintf(rig.cameras[c].name, RIG_NAME, "cam%d", c);
        rig_camera_look_at(&rig.cameras[c], at_mm(15 + 20 * c, 90 * c, 650), vec3(0, 0, 0));
    }
    for (int i = 0; i < 16; i++)
        stand(&rig, i < 8 ? 30 : 60, 22.5 + 45 * i);
    return rig;
}

/* Every view gets every light, each from the lamp that stands there when the sample is turned. */
TEST(fixed_lamps) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\nrings=15:8; 35:8; 55:8; 75:8\n[lights]\ndevices=all\n");
    struct rig rig = four_cameras();
    struct rig_timing timing = plan_case_timing(0.25);
    int seen[32][16] = {{0}};

    timing.arc = (struct axis_motion){0};
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(plan->session.n_views, ==, 32);
    g_assert_cmpint(plan->session.n_lights, ==, 16);
    g_assert_cmpint(plan->n_poses, ==, 8);
    g_assert_cmpint(plan->notes->len, ==, 0);
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        const struct session_direction *light = &plan->session.lights[shot->source];
        const struct vec3 at =
            rig_turn(rig.lamps[shot->device].position_mm, -RAD(shot->turntable_deg));
        const struct vec3 towards = at_mm(light->theta_deg, light->phi_deg, 400);
        g_assert_cmpfloat(vec3_length(vec3_sub(at, towards)), <, 1e-3);
        g_assert_cmpfloat(shot->arc_deg, ==, 0);
        for (int v = 0; v < 32; v++) {
            const struct session_direction *view = &plan->session.views[v];
            seen[v][shot->source] += view->turntable_deg == shot->turntable_deg &&
                                     camera_set_has(shot->cameras, view->device);
        }
    }
    for (int v = 0; v < 32; v++)
        for (int l = 0; l < 16; l++)
            g_assert_cmpint(seen[v][l], ==, 1);

    /* at 30° the lamps fall between each other: those lights are not there, and it is said */
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=15:12\n[lights]\ndevices=all\n");
    g_autoptr(Plan) partly = plan_case_build(&conf, &rig, &timing);
    int skipped = 0;
    for (int i = 0; i < partly->session.n_shots; i++)
        skipped += partly->session.shots[i].state == SHOT_SKIPPED;
    g_assert_cmpint(skipped, ==, 8 * 16);
    g_assert_cmpstr(partly->notes->pdata[0], ==,
                    "128 shots: skipped: no lamp stands where its light would come from");
    g_assert_true(g_str_has_prefix(partly->notes->pdata[1], "8 of 12 views miss more than"));

    /* a camera right in a lamp's light */
    session_conf_clear(&conf);
    conf = plan_case_conf("[views]\nrings=15:8\n[lights]\ndevices=all\n");
    rig.lamps[0].position_mm = at_mm(15, 0, 900);
    g_autoptr(Plan) shaded = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(shaded->session.n_shots, ==, 1 + 8 * 16);
    g_assert_cmpstr(shaded->notes->pdata[0], ==,
                    "1 shot: skipped: lamp led1 and cam0 are in each other's way");
    conf.on_blocked = BLOCKED_REFUSE;
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_BLOCKED, "lamp led1 and cam0");
}

/* An arc next to lamps that stand by themselves: it gives the lights at its lamps' elevations, they
 * theirs, during which it stands at 0, or aside where it would be in the picture there. */
TEST(arc_and_fixed_lamps) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\nrings=30:1:180\n[lights]\nrings=30:2; 50:1:100\n");
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    struct rig_timing timing = plan_case_timing(0.25);

    stand(&rig, 50, 280);
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    int fixed = 0;
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        if (shot->device != 5)
            continue;
        fixed++;
        g_assert_cmpfloat(shot->turntable_deg, ==, 180);
        g_assert_cmpint(shot->state, ==, SHOT_PLANNED);
        g_assert_true(g_str_has_prefix(shot->note, "arc shifted by"));
        g_assert_cmpfloat(rig_arc_clearance_mm(&rig, 1, RAD(shot->arc_deg), 36), >, 0);
    }
    g_assert_cmpint(fixed, ==, 1);
    g_assert_cmpint(plan->session.n_shots, ==, 4);
}

/* A camera that stands still and one at four stops of an arm: every view gets every light once,
 * with the arm where its camera is; and the order spares moves of the arm. */
TEST(arm) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\nrings=15:8; 25:8; 35:8; 45:8; 55:8\n[lights]\ndevices=all\n");
    struct rig rig = four_cameras();
    struct rig_timing timing = plan_case_timing(0.25);
    int seen[40][16] = {{0}}, moves = 0;
    double arm_deg = -1;

    timing.arc = (struct axis_motion){0};
    timing.arm = (struct axis_motion){0, 40, FALSE, 10, 20, 0, 500};
    rig.arm.axis = vec3(0, 1, 0);
    rig.n_cameras = 5;
    rig.cameras[0].on_arm = FALSE;
    for (int c = 1; c < 5; c++) {
        rig.cameras[c] = (struct rig_camera){
            .width = 160, .height = 160, .on_arm = TRUE, .arm_deg = 10 * c, .stop = c - 1};
        g_snprintf(rig.cameras[c].name, RIG_NAME, "arm@%d", 10 * c);
        rig_camera_look_at(&rig.cameras[c], at_mm(15 + 10 * c, 0, 650), vec3(0, 0, 0));
    }
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(plan->session.n_views, ==, 40);
    g_assert_cmpint(plan->session.n_shots, ==, 1 + 8 * 4 * 16); /* the still one joins the others */
    /* a dark frame of each device */
    g_assert_true(camera_set_equal(plan->session.shots[0].cameras, (struct camera_set){{3}}));
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        const double at_deg = rig_arm_deg(&rig, shot->cameras);
        moves += at_deg != arm_deg;
        arm_deg = at_deg;
        for (int c = 1; c < 5; c++)
            g_assert_true(!camera_set_has(shot->cameras, c) || at_deg == rig.cameras[c].arm_deg);
        for (int v = 0; v < 40; v++) {
            const struct session_direction *view = &plan->session.views[v];
            seen[v][shot->source] += view->turntable_deg == shot->turntable_deg &&
                                     camera_set_has(shot->cameras, view->device);
        }
    }
    for (int v = 0; v < 40; v++)
        for (int l = 0; l < 16; l++)
            g_assert_cmpint(seen[v][l], ==, 1);
    g_assert_cmpint(moves, ==, 4);
    g_assert_cmpfloat(plan->predicted_s, >=, plan->lower_bound_s);
    g_assert_cmpfloat(plan->predicted_s, <, 1.05 * plan->lower_bound_s);
    g_assert_cmpfloat(plan->predicted_s, <, 0.9 * plan->nested_s);

    timing.arm.max_deg = 30;
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_LIMITS, "[axis arm] cannot turn to 40");
}

/* One lamp at three stops of a probe on the arc: each light from its own stop; the lamp that is on
 * stays on while the probe moves. */
TEST(probe) {
    g_auto(SessionConf) conf =
        plan_case_conf("[views]\nrings=30:4\n[lights]\nrings=15:4:45; 45:4:45; 75:4:45\n");
    struct rig rig = plan_case_rig(demo_theta_deg, 5);
    struct rig_timing timing = plan_case_timing(20);

    timing.probe = (struct axis_motion){0, 60, FALSE, 30, 60, 0, 200};
    rig.probe.axis = vec3(0, 1, 0);
    rig.n_lamps = 3;
    for (int l = 0; l < 3; l++) {
        const double theta_deg = 15 + 30 * l;
        rig.lamps[l] = (struct rig_lamp){.position_mm = at_mm(theta_deg, 0, 500),
                                         .aim = vec3_scale(at_mm(theta_deg, 0, 1), -1),
                                         .on_probe = TRUE,
                                         .probe_deg = 30 * l,
                                         .stop = l};
        g_snprintf(rig.lamps[l].name, RIG_NAME, "lamp@%d", 30 * l);
    }
    g_autoptr(Plan) plan = plan_case_build(&conf, &rig, &timing);
    g_assert_cmpint(plan->session.n_lights, ==, 12);
    g_assert_cmpint(plan->session.n_shots, ==, 1 + 4 * 12);
    for (int i = 1; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        const struct session_direction *light = &plan->session.lights[shot->source];
        const struct vec3 at =
            rig_turn(rig.lamps[shot->device].position_mm, RAD(shot->arc_deg - shot->turntable_deg));
        const struct vec3 towards = at_mm(light->theta_deg, light->phi_deg, 500);
        g_assert_cmpint(shot->state, ==, SHOT_PLANNED);
        g_assert_cmpfloat(vec3_length(vec3_sub(at, towards)), <, 1e-3);
        g_assert_cmpfloat(rig_probe_deg(&rig, shot->device), ==, 30 * shot->device);
    }
    /* It warms up once. */
    g_assert_cmpfloat(plan->predicted_s, <, 20 + 48 * 4);
    timing.probe.max_deg = 50;
    plan_case_refused(&conf, &rig, &timing, PLAN_ERROR_LIMITS, "[axis probe] cannot turn to 60");
}

BEFORE_TESTS {
    setlocale(LC_ALL, "");
}
