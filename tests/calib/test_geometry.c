#include "geometry/rig.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <locale.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static void assert_near(double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance))
        g_error("%.17g is not %.17g within %g", a, b, tolerance);
}

static void assert_vec(struct vec3 a, struct vec3 b, double tolerance) {
    assert_near(a.x, b.x, tolerance);
    assert_near(a.y, b.y, tolerance);
    assert_near(a.z, b.z, tolerance);
}

static void assert_projects(const struct rig_camera *camera, struct vec3 point, double x, double y,
                            double tolerance) {
    double found_x, found_y;
    g_assert_true(rig_project(camera, point, &found_x, &found_y));
    assert_near(found_x, x, tolerance);
    assert_near(found_y, y, tolerance);
}

static struct rig_camera pinhole(void) {
    return (struct rig_camera){.name = "cam",
                               .width = 160,
                               .height = 120,
                               .fx_px = 1000,
                               .fy_px = 1000,
                               .cx_px = 79.5,
                               .cy_px = 59.5,
                               .response = 1};
}

/* From straight above at 500 mm with 1000 px: two pixels a millimetre. A camera at azimuth 0 tilted
 * up to the zenith has +y to its right and, upside, −x: image down is +x. */
TEST(overhead) {
    struct rig_camera camera = pinhole();
    double x, y;

    rig_camera_look_at(&camera, vec3(0, 0, 500), vec3(0, 0, 0));
    assert_projects(&camera, vec3(0, 0, 0), 79.5, 59.5, 1e-12);
    assert_projects(&camera, vec3(0, 10, 0), 99.5, 59.5, 1e-10);
    assert_projects(&camera, vec3(10, 0, 250), 79.5, 99.5, 1e-10);
    assert_vec(rig_camera_centre_mm(&camera), vec3(0, 0, 500), 1e-10);
    g_assert_false(rig_project(&camera, vec3(0, 0, 500), &x, &y));
    g_assert_false(rig_project(&camera, vec3(0, 0, 501), &x, &y));
    g_assert_false(rig_project(&camera, vec3(NAN, 0, 0), &x, &y) && isfinite(x));
}

/* At 45° over +x, 500·√2 mm away: the ray to (0, 0, z) leaves the axis by hand-made triangles. */
TEST(oblique) {
    struct rig_camera camera = pinhole();

    rig_camera_look_at(&camera, vec3(500, 0, 500), vec3(0, 0, 0));
    /* along the axis 500√2 − 100/√2, across it 100/√2 up */
    assert_projects(&camera, vec3(0, 0, 100), 79.5,
                    59.5 - 1000 * (100 / sqrt(2)) / (500 * sqrt(2) - 100 / sqrt(2)), 1e-10);
    assert_projects(&camera, vec3(0, 70, 0), 79.5 + 1000 * 70 / (500 * sqrt(2)), 59.5, 1e-10);
    assert_vec(rig_pixel_ray(&camera, 79.5, 59.5), vec3(-M_SQRT1_2, 0, -M_SQRT1_2), 1e-12);
    assert_vec(rig_camera_centre_mm(&camera), vec3(500, 0, 500), 1e-10);
}

/* OpenCV's manual, with numbers: at x' = 0.3, y' = −0.2 r² is 0.13. */
TEST(distortion) {
    struct rig_camera camera = pinhole();

    camera.rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    camera.k1 = -0.2;
    camera.k2 = 0.1;
    camera.k3 = 0.05;
    camera.p1 = 0.01;
    camera.p2 = -0.02;
    double radial = 1 - 0.2 * 0.13 + 0.1 * 0.0169 + 0.05 * 0.002197;
    assert_projects(&camera, vec3(30, -20, 100),
                    79.5 + 1000 * (0.3 * radial + 2 * 0.01 * -0.06 - 0.02 * (0.13 + 0.18)),
                    59.5 + 1000 * (-0.2 * radial + 0.01 * (0.13 + 0.08) + 2 * -0.02 * -0.06), 1e-9);
}

/* With k1 = −0.3 alone the distorted radius is largest at r² = 1/0.9. */
TEST(fold) {
    struct rig_camera camera = pinhole();
    double x, y, edge = sqrt(1 / 0.9);

    camera.rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    camera.k1 = -0.3;
    g_assert_true(rig_project(&camera, vec3(0.999 * edge, 0, 1), &x, &y));
    g_assert_false(rig_project(&camera, vec3(1.001 * edge, 0, 1), &x, &y));
    g_assert_false(rig_project(&camera, vec3(3, 0, 1), &x, &y));
    /* d(r'')/dr' = 1 − 3r² + 2r⁴ is negative between r² = ½ and 1: what lies beyond that is in
     * front of the fold again, and not to be trusted either */
    camera.k1 = -1;
    camera.k2 = 0.4;
    g_assert_true(rig_project(&camera, vec3(0.7, 0, 1), &x, &y));
    g_assert_false(rig_project(&camera, vec3(0.8, 0, 1), &x, &y));
    g_assert_false(rig_project(&camera, vec3(1.2, 0, 1), &x, &y));
}

static struct rig_camera random_camera(GRand *rand) {
    struct rig_camera camera = pinhole();
    struct vec3 target = vec3(g_rand_double_range(rand, -20, 20),
                              g_rand_double_range(rand, -20, 20), g_rand_double_range(rand, 0, 10));
    double theta = g_rand_double_range(rand, 0, 1.4), phi = g_rand_double_range(rand, -7, 7);

    camera.fx_px = g_rand_double_range(rand, 200, 3000);
    camera.fy_px = camera.fx_px * g_rand_double_range(rand, 0.9, 1.1);
    camera.cx_px += g_rand_double_range(rand, -10, 10);
    camera.cy_px += g_rand_double_range(rand, -10, 10);
    camera.k1 = g_rand_double_range(rand, -0.3, 0.3);
    camera.k2 = g_rand_double_range(rand, -0.1, 0.1);
    camera.k3 = g_rand_double_range(rand, -0.02, 0.02);
    camera.p1 = g_rand_double_range(rand, -0.005, 0.005);
    camera.p2 = g_rand_double_range(rand, -0.005, 0.005);
    rig_camera_look_at(&camera, vec3_scale(rig_direction(theta, phi), 600), target);
    return camera;
}

TEST(ray_round_trip) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    double worst = 0;

    for (int i = 0; i < 20000; i++) {
        struct rig_camera camera = random_camera(rand);
        double x = g_rand_double_range(rand, -20, 180), y = g_rand_double_range(rand, -20, 140);
        struct vec3 ray = rig_pixel_ray(&camera, x, y);
        assert_near(vec3_length(ray), 1, 1e-12);
        struct vec3 point = vec3_add(rig_camera_centre_mm(&camera), vec3_scale(ray, 600));
        double x2, y2;
        g_assert_true(rig_project(&camera, point, &x2, &y2));
        worst = MAX(worst, hypot(x2 - x, y2 - y));
    }
    g_test_message("worst round trip: %.2g px", worst);
    g_assert_cmpfloat(worst, <, 1e-8); /* the inversion itself is to 1e-9 */
}

TEST(wild_pixels) {
    struct rig_camera camera = pinhole();
    const double wild[] = {-1e300, -1e6, 0, 1e6, 1e300};

    rig_camera_look_at(&camera, vec3(500, 0, 500), vec3(0, 0, 0));
    camera.k1 = -0.5;
    camera.k3 = 1;
    for (gsize i = 0; i < G_N_ELEMENTS(wild); i++)
        for (gsize j = 0; j < G_N_ELEMENTS(wild); j++)
            rig_pixel_ray(&camera, wild[i], wild[j]); /* ends, and that is all there is to ask */
    rig_pixel_ray(&camera, NAN, INFINITY);
}

TEST(look_at) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(2);

    for (int i = 0; i < 1000; i++) {
        struct rig_camera camera = random_camera(rand);
        const double(*m)[3] = camera.rotation.m;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                assert_near(m[r][0] * m[c][0] + m[r][1] * m[c][1] + m[r][2] * m[c][2], r == c,
                            1e-12);
        assert_near(m[0][2], 0, 1e-12);    /* image x is level */
        g_assert_cmpfloat(m[1][2], <=, 0); /* and y points down */
        double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                     m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                     m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
        assert_near(det, 1, 1e-12);
    }
}

TEST(turn_and_angles) {
    double theta, phi;

    assert_vec(rig_turn(vec3(1, 0, 5), RAD(90)), vec3(0, 1, 5), 1e-15);
    assert_vec(rig_turn(vec3(0, 2, 0), RAD(-90)), vec3(2, 0, 0), 1e-15);
    rig_angles(vec3(0, 0, 1), &theta, &phi);
    assert_near(theta, 0, 0);
    assert_near(phi, 0, 0);
    rig_angles(vec3(0, -3, 3), &theta, &phi);
    assert_near(theta, RAD(45), 1e-15);
    assert_near(phi, RAD(270), 1e-15);
    rig_angles(vec3(1, -1e-300, 0), &theta, &phi);
    g_assert_cmpfloat(phi, <, 2 * G_PI);
    rig_angles(vec3(0, 0, -1), &theta, &phi);
    assert_near(theta, G_PI, 1e-15);
    assert_vec(rig_direction(RAD(30), RAD(90)), vec3(0, 0.5, sqrt(0.75)), 1e-15);
}

TEST(lamp) {
    struct rig_lamp lamp = {.position_mm = vec3(300, 0, 400),
                            .aim = vec3(-0.6, 0, -0.8),
                            .exponent = 2,
                            .intensity = 40};

    /* on its axis at 0.5 m: 40 / 0.25 */
    assert_near(rig_lamp_irradiance(NULL, &lamp, 0, vec3(0, 0, 0)), 160, 1e-9);
    assert_near(rig_lamp_irradiance(NULL, &lamp, RAD(123), vec3(0, 0, 0)), 160, 1e-9);
    assert_vec(rig_lamp_position_mm(NULL, &lamp, RAD(90)), vec3(0, 300, 400), 1e-10);
    /* the point straight below: cos = 0.8, 0.4 m */
    assert_near(rig_lamp_irradiance(NULL, &lamp, 0, vec3(300, 0, 0)), 40 * 0.64 / 0.16, 1e-9);
    assert_near(rig_lamp_irradiance(NULL, &lamp, RAD(90), vec3(0, 300, 0)), 40 * 0.64 / 0.16, 1e-9);
    assert_near(rig_lamp_irradiance(NULL, &lamp, 0, vec3(600, 0, 800)), 0, 0); /* behind it */
}

static struct rig_laser laser_at(double theta, double distance) {
    struct vec3 u = vec3_scale(rig_direction(theta, 0), -1);
    struct rig_laser laser = {.position_mm = vec3_scale(u, -distance), .axis = vec3(0, 1, 0)};

    laser.normal = vec3_unit(vec3_cross(laser.axis, u));
    return laser;
}

TEST(laser) {
    struct rig_laser laser = laser_at(RAD(45), 480);
    struct rig_plane sheet = rig_laser_sheet(NULL, &laser, 0, 0);

    assert_near(sheet.offset_mm, 0, 1e-10); /* through the origin, and the whole y axis */
    assert_near(vec3_dot(sheet.normal, vec3(0, 7, 0)), 0, 1e-12);
    /* swept by 1° the line on the table lies where a ray 1° off the axis comes down: right-handed
     * about +y turns the beam (−1, 0, −1) towards −x */
    double side = 480 * M_SQRT1_2;
    sheet = rig_laser_sheet(NULL, &laser, 0, RAD(1));
    double x = side - side * tan(RAD(46));
    assert_near(vec3_dot(sheet.normal, vec3(x, 3, 0)), sheet.offset_mm, 1e-9);
    assert_near(rig_laser_sweep_rad(NULL, &laser, 0, vec3(x, -3, 0)), RAD(1), 1e-12);
    assert_near(rig_laser_sweep_rad(NULL, &laser, RAD(90), vec3(3, x, 0)), RAD(1), 1e-12);
    assert_vec(rig_laser_position_mm(NULL, &laser, RAD(90)), vec3(0, side, side), 1e-9);
}

/* An arc that hangs crooked, worked out by hand: tilted by 90° about x, z becomes −y. */
TEST(crooked_arc) {
    const struct rig_arc arc = {
        .zero_rad = RAD(90), .tilt_rad = {G_PI_2, 0}, .centre_mm = {10, 20}};
    struct vec3 p = vec3(300, 0, 400); /* turned by −90 + 90°, tilted, moved */

    assert_vec(rig_arc_point(&arc, RAD(-90), p), vec3(310, -380, 0), 1e-9);
    assert_vec(rig_arc_direction(&arc, 0, vec3(1, 0, 0)), vec3(0, 0, 1), 1e-12);
    g_autoptr(GRand) rand = g_rand_new_with_seed(6);
    for (int i = 0; i < 1000; i++) {
        struct rig_arc crooked = {
            g_rand_double(rand), {g_rand_double(rand) - 0.5, g_rand_double(rand) - 0.5}, {3, -4}};
        struct rig_laser laser = laser_at(g_rand_double_range(rand, 0.05, 1.4), 480);
        double alpha = g_rand_double_range(rand, -7, 7);
        struct vec3 q = vec3(g_rand_double(rand), g_rand_double(rand), g_rand_double(rand));
        assert_vec(rig_arc_point_back(&crooked, alpha, rig_arc_point(&crooked, alpha, q)), q, 1e-9);
        laser.stretch = 0.01;
        double sweep = rig_laser_sweep_rad(&crooked, &laser, alpha, q);
        struct rig_plane sheet = rig_laser_sheet(&crooked, &laser, alpha, sweep);
        assert_near(vec3_dot(sheet.normal, q), sheet.offset_mm, 1e-9);
        assert_near(vec3_dot(sheet.normal, rig_laser_position_mm(&crooked, &laser, alpha)),
                    sheet.offset_mm, 1e-9);
    }
}

/* What stands by itself is where it says, however the arc hangs and stands; and what is carried is
 * as it would be without being asked. */
TEST(fixed) {
    const struct rig_arc crooked = {RAD(20), {0.1, -0.2}, {3, -4}};
    struct rig_laser laser = laser_at(RAD(40), 480);
    struct rig_lamp lamp = {.position_mm = {300, 0, 400},
                            .aim = {-0.6, 0, -0.8},
                            .exponent = 2,
                            .intensity = 40,
                            .fixed = 1};
    const struct vec3 q = vec3(4, -5, 6);

    laser.fixed = 1;
    for (int i = 0; i < 8; i++) {
        const double alpha = RAD(50 * i);
        assert_vec(rig_lamp_position_mm(&crooked, &lamp, alpha), vec3(300, 0, 400), 0);
        assert_vec(rig_lamp_point_back(&crooked, &lamp, alpha, q), q, 0);
        assert_near(rig_lamp_irradiance(&crooked, &lamp, alpha, vec3(0, 0, 0)), 160, 1e-9);
        assert_vec(rig_laser_position_mm(&crooked, &laser, alpha), laser.position_mm, 0);
        assert_vec(rig_laser_axis(&crooked, &laser, alpha), vec3(0, 1, 0), 0);
        const double sweep = rig_laser_sweep_rad(&crooked, &laser, alpha, q);
        assert_near(sweep, rig_laser_sweep_rad(NULL, &laser, 0, q), 0);
        const struct rig_plane sheet = rig_laser_sheet(&crooked, &laser, alpha, sweep);
        assert_near(vec3_dot(sheet.normal, q), sheet.offset_mm, 1e-9);
    }
    lamp.fixed = 0;
    assert_vec(rig_arc_point_back(&crooked, 1, rig_lamp_position_mm(&crooked, &lamp, 1)),
               vec3(300, 0, 400), 1e-9);
    g_assert_cmpfloat(rig_lamp_position_mm(&crooked, &lamp, 1).y, >, 100);
}

/* A bent sheet: its light at a point is on the plane that is turned by the bend there, and the
 * lever of each error is what a change of that parameter does. */
TEST(bent_sheet) {
    const struct rig_arc crooked = {RAD(20), {0.1, -0.2}, {3, -4}};
    g_autoptr(GRand) rand = g_rand_new_with_seed(9);

    for (int i = 0; i < 200; i++) {
        struct rig_laser laser = laser_at(g_rand_double_range(rand, 0.3, 1.2), 480), other;
        const double arc = g_rand_double_range(rand, -3, 3);
        const struct vec3 p =
            vec3(g_rand_double_range(rand, -40, 40), g_rand_double_range(rand, -40, 40), 3);
        double lever[RIG_SHEET_PARAMETERS];
        laser.stretch = 0.01;
        laser.bend_rad = g_rand_double_range(rand, -0.1, 0.1);
        const double sweep = rig_laser_sweep_rad(&crooked, &laser, arc, p);
        const double bent = rig_laser_bent_rad(&crooked, &laser, arc, p);
        const struct rig_plane sheet = rig_laser_sheet(&crooked, &laser, arc, sweep + bent);
        const struct rig_laser placed = rig_laser_placed(&crooked, &laser, arc);
        assert_vec(rig_laser_sheet(NULL, &placed, 0, sweep + bent).normal, sheet.normal, 1e-12);
        assert_near(rig_laser_sheet(NULL, &placed, 0, sweep + bent).offset_mm, sheet.offset_mm,
                    1e-9);
        assert_near(rig_laser_bent_rad(NULL, &placed, 0, p), bent, 1e-12);
        assert_near(vec3_dot(sheet.normal, p), sheet.offset_mm, 1e-9);
        /* How far the sheet moves when it is bent more. */
        other = laser;
        other.bend_rad += 1e-4;
        const struct rig_plane moved = rig_laser_sheet(
            &crooked, &other, arc, sweep + rig_laser_bent_rad(&crooked, &other, arc, p));
        rig_laser_sheet_lever(&crooked, &laser, arc, p, lever);
        assert_near((moved.offset_mm - vec3_dot(moved.normal, p)) / 1e-4, lever[RIG_SHEET_BEND],
                    1e-2);
    }
}

TEST(sheet_through_points) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(3);

    for (int i = 0; i < 5000; i++) {
        struct rig_laser laser =
            laser_at(g_rand_double_range(rand, 0.05, 1.4), g_rand_double_range(rand, 200, 800));
        struct vec3 p = vec3(g_rand_double_range(rand, -50, 50), g_rand_double_range(rand, -50, 50),
                             g_rand_double_range(rand, 0, 10));
        double arc = g_rand_double_range(rand, -7, 7);
        double sweep = rig_laser_sweep_rad(NULL, &laser, arc, p);
        struct rig_plane sheet = rig_laser_sheet(NULL, &laser, arc, sweep);
        g_assert_cmpfloat(fabs(sweep), <, 0.5);
        assert_near(vec3_length(sheet.normal), 1, 1e-12);
        assert_near(vec3_dot(sheet.normal, p), sheet.offset_mm, 1e-9);
        assert_near(vec3_dot(sheet.normal, rig_laser_position_mm(NULL, &laser, arc)),
                    sheet.offset_mm, 1e-9);
    }
}

TEST(clearance) {
    struct rig rig = {.n_cameras = 1, .arc_radius_mm = 500, .arc_width_mm = 30};

    rig.cameras[0] = pinhole();
    rig_camera_look_at(&rig.cameras[0], vec3(800 * M_SQRT1_2, 0, 800 * M_SQRT1_2), vec3(0, 0, 0));
    /* right behind the arc: half the band and the cone are in the way */
    assert_near(rig_arc_clearance_mm(&rig, 0, 0, 40), -15 - 40 * (1 - 500.0 / 800), 1e-9);
    /* a quarter turn away the nearest point of the arc is its upper end, 45° off */
    assert_near(rig_arc_clearance_mm(&rig, 0, RAD(90), 40),
                500 * 2 * sin(RAD(22.5)) - 15 - 40 * (1 - 500.0 / 800), 1e-9);
    assert_near(rig_arc_clearance_mm(&rig, 0, RAD(180), 40),
                500 * 2 * sin(RAD(22.5)) - 15 - 40 * (1 - 500.0 / 800), 1e-9);
    g_assert_cmpfloat(rig_arc_clearance_mm(&rig, 0, RAD(20), 0), >,
                      rig_arc_clearance_mm(&rig, 0, RAD(10), 0));
    rig.arc_radius_mm = 900;
    g_assert_cmpfloat(rig_arc_clearance_mm(&rig, 0, 0, 40), >, 1e6); /* the arc is behind it */
    rig.arc_radius_mm = 0;
    g_assert_cmpfloat(rig_arc_clearance_mm(&rig, 0, 0, 40), >, 1e6); /* there is no arc */
}

static struct rig random_rig(GRand *rand) {
    struct rig rig = {
        .id = " odd; \"id\" \\ # é ", .arc_radius_mm = 500.1, .arc_width_mm = 1.0 / 3};

    rig.n_cameras = 3;
    rig.n_lamps = 2;
    rig.n_lasers = 2;
    for (int i = 0; i < 3; i++) {
        rig.cameras[i] = random_camera(rand);
        rig.cameras[i].response = g_rand_double_range(rand, 1e-3, 1e9);
        rig.cameras[i].vignetting = g_rand_double(rand) * 0.5;
        g_snprintf(rig.cameras[i].name, RIG_NAME, "cam %d", i);
    }
    for (int i = 0; i < 2; i++) {
        struct vec3 d = rig_direction(g_rand_double(rand), g_rand_double(rand));
        rig.lamps[i] = (struct rig_lamp){.position_mm = vec3_scale(d, 500),
                                         .aim = vec3_unit(vec3_scale(d, -1)),
                                         .exponent = g_rand_double(rand),
                                         .intensity = 1e-300};
        g_snprintf(rig.lamps[i].name, RIG_NAME, "lamp%d", i);
        rig.lasers[i] = laser_at(g_rand_double(rand) + 0.1, 480);
        g_snprintf(rig.lasers[i].name, RIG_NAME, "laser%d", i);
    }
    rig.arc = (struct rig_arc){g_rand_double(rand), {g_rand_double(rand), -0.0}, {1e-300, 7}};
    rig.lasers[1].stretch = g_rand_double_range(rand, -0.4, 0.4);
    rig.lamps[1].fixed = rig.lasers[1].fixed = g_rand_boolean(rand);
    rig.cameras[0].k1 = -0.0;
    rig.cameras[1].k1 = 5e-324;
    return rig;
}

/* In the frame of rig_at() the sample turns about z, and everything is seen as in the rig frame
 * with the wobble. */
TEST(wobble) {
    g_autofree struct rig *rig = g_new0(struct rig, 1), *at = g_new0(struct rig, 1);
    rig->n_cameras = rig->n_lamps = rig->n_lasers = 1;
    rig->cameras[0] = pinhole();
    rig_camera_look_at(&rig->cameras[0], vec3(200, 100, 400), vec3(0, 0, 0));
    rig->lamps[0] = (struct rig_lamp){.position_mm = {300, -50, 350},
                                      .aim = {0, 0, -1},
                                      .exponent = 3,
                                      .intensity = 5,
                                      .fixed = 1};
    rig->lasers[0] = (struct rig_laser){
        .position_mm = {0, 300, 400}, .axis = {1, 0, 0}, .normal = {0, 0.8, -0.6}, .fixed = 1};
    g_strlcpy(rig->id, "wobbling", sizeof rig->id);
    g_strlcpy(rig->lamps[0].name, "lamp", RIG_NAME);
    g_strlcpy(rig->lasers[0].name, "laser", RIG_NAME);
    rig->wobble.rad[1][0] = 0.001;
    rig->wobble.rad[1][3] = -0.002;
    rig->wobble.rad[3][2] = 0.0005;
    for (int k = 0; k < 12; k++) {
        const double turn = RAD(31 * k), arc = RAD(20 * k);
        const struct vec3 p = vec3(12, -17, 3), there = rig_sample_point(rig, turn, p);
        double x, y, tilt[2];
        rig_wobble_tilt(&rig->wobble, turn, tilt);
        assert_near(tilt[0], 0.001 * cos(2 * turn), 1e-15);
        assert_near(tilt[1], -0.002 * sin(2 * turn) + 0.0005 * cos(4 * turn), 1e-15);
        g_assert_cmpfloat(hypot(tilt[0], tilt[1]), <=, rig_wobble_most_rad(&rig->wobble) + 1e-6);
        /* A rotation by the vector (x, y, 0), to first order. */
        const struct vec3 level = rig_turn(p, turn);
        assert_vec(there,
                   vec3(level.x + tilt[1] * level.z, level.y - tilt[0] * level.z,
                        level.z + tilt[0] * level.y - tilt[1] * level.x),
                   1e-3 * 0.1);
        rig_at(rig, turn, at);
        g_assert_true(rig_project(&rig->cameras[0], there, &x, &y));
        assert_projects(&at->cameras[0], level, x, y, 1e-9);
        assert_near(rig_lamp_irradiance(NULL, &at->lamps[0], 0, level),
                    rig_lamp_irradiance(NULL, &rig->lamps[0], 0, there), 1e-12);
        assert_near(rig_laser_sweep_rad(NULL, &at->lasers[0], 0, level),
                    rig_laser_sweep_rad(NULL, &rig->lasers[0], 0, there), 1e-12);
        /* What the arc carries: to first order. */
        const struct vec3 lamp = vec3(250, 0, 430);
        assert_vec(rig_tilt_point(tilt, rig_arc_point(&at->arc, arc, lamp), 1),
                   rig_arc_point(&rig->arc, arc, lamp), 1e-9);
        assert_vec(rig_tilt_point(tilt, rig_camera_centre_mm(&at->cameras[0]), 1),
                   rig_camera_centre_mm(&rig->cameras[0]), 1e-9);
        assert_vec(rig_tilt_point(tilt, at->lasers[0].normal, 1), rig->lasers[0].normal, 1e-12);
    }
    /* It is in the file, and in no file of a rig without wobble. */
    g_autofree char *text = rig_to_text(rig);
    g_assert_true(ok(rig_from_text(at, text, NULL, ERR)));
    g_assert_cmpmem(&at->wobble, sizeof at->wobble, &rig->wobble, sizeof rig->wobble);
    memset(&rig->wobble, 0, sizeof rig->wobble);
    g_autofree char *without = rig_to_text(rig);
    g_assert_null(strstr(without, "wobble"));
}

/* A rig with as many cameras and lamps as a rig may have. */
TEST(text_of_largest) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    g_autofree struct rig *rig = g_new0(struct rig, 1), *read = g_new0(struct rig, 1);
    *rig = random_rig(rand);
    rig->n_cameras = RIG_MAX_CAMERAS;
    rig->n_lamps = RIG_MAX_LAMPS;
    for (int c = 3; c < RIG_MAX_CAMERAS; c++) {
        rig->cameras[c] = rig->cameras[c % 3];
        rig->cameras[c].fx_px = 1000 + c;
        g_snprintf(rig->cameras[c].name, RIG_NAME, "cam %d", c);
    }
    for (int l = 1; l < RIG_MAX_LAMPS; l++) {
        rig->lamps[l] = rig->lamps[0];
        rig->lamps[l].exponent = 1 + l;
        g_snprintf(rig->lamps[l].name, RIG_NAME, "lamp %d", l);
    }
    g_autofree char *text = rig_to_text(rig);
    g_assert_true(ok(rig_from_text(read, text, "calibration.conf", ERR)));
    g_assert_cmpint(read->n_cameras, ==, 256);
    g_assert_cmpint(read->n_lamps, ==, 1024);
    g_assert_cmpstr(read->cameras[255].name, ==, "cam 255");
    g_assert_cmpfloat(read->cameras[255].fx_px, ==, 1255);
    g_assert_cmpstr(read->lamps[1023].name, ==, "lamp 1023");
    g_assert_cmpfloat(read->lamps[1023].exponent, ==, 1024);
    g_autofree char *again = rig_to_text(read);
    g_assert_cmpstr(text, ==, again);
}

TEST(text_round_trip) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(4);

    for (int i = 0; i < 50; i++) {
        struct rig rig = random_rig(rand), read;
        g_autofree char *text = rig_to_text(&rig);
        memset(&read, 0xa5, sizeof read);
        g_assert_true(ok(rig_from_text(&read, text, "calibration.conf", ERR)));
        g_autofree char *again = rig_to_text(&read);
        g_assert_cmpstr(text, ==, again);
        g_assert_cmpstr(read.id, ==, rig.id);
        g_assert_cmpstr(read.cameras[2].name, ==, "cam 2");
        g_assert_true(memcmp(&read.cameras[1].fx_px, &rig.cameras[1].fx_px,
                             sizeof rig.cameras[1] - offsetof(struct rig_camera, fx_px)) == 0);
        g_assert_true(memcmp(&read.lamps[1].position_mm, &rig.lamps[1].position_mm,
                             offsetof(struct rig_lamp, fixed) + sizeof(int) -
                                 offsetof(struct rig_lamp, position_mm)) == 0);
        g_assert_true(memcmp(&read.lasers[1].position_mm, &rig.lasers[1].position_mm,
                             offsetof(struct rig_laser, fixed) + sizeof(int) -
                                 offsetof(struct rig_laser, position_mm)) == 0);
        g_assert_true(signbit(read.cameras[0].k1));
        g_assert_cmpmem(&read.arc, sizeof read.arc, &rig.arc, sizeof rig.arc);
    }
}

/* As written before arcs were measured: an ideal one. */
TEST(text_without_arc) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(8);
    struct rig rig = random_rig(rand), read;
    g_autofree char *text = rig_to_text(&rig);
    g_autoptr(GRegex) lines =
        g_regex_new("(arc_zero|arc_tilt|arc_centre|stretch)[^\n]*\n", 0, 0, NULL);
    g_autofree char *old = g_regex_replace(lines, text, -1, 0, "", 0, NULL);

    g_assert_true(ok(rig_from_text(&read, old, "calibration.conf", ERR)));
    const struct rig_arc ideal = {0};
    g_assert_cmpmem(&read.arc, sizeof read.arc, &ideal, sizeof ideal);
    g_assert_true(read.lasers[1].stretch == 0);
}

TEST(text_truncated) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    struct rig rig = random_rig(rand);
    g_autofree char *text = rig_to_text(&rig);
    gsize length = strlen(text);

    for (gsize n = 0; n < length; n++) {
        struct rig read = {.n_cameras = 77};
        g_autoptr(GError) error = NULL;
        g_autofree char *part = g_strndup(text, n);
        gboolean ok = rig_from_text(&read, part, "x.conf", &error);
        g_assert_true(ok == (n >= length - 1)); /* only the last line's end may be missing */
        if (!ok) {
            g_assert_true(g_str_has_prefix(error->message, "x.conf: "));
            g_assert_cmpint(read.n_cameras, ==, 77); /* nothing half-read is handed out */
        }
    }
}

static void assert_refused(const char *text, const char *from, const char *to, const char *says) {
    g_auto(GStrv) parts = g_strsplit(text, from, 2);
    g_assert_cmpuint(g_strv_length(parts), ==, 2);
    g_autofree char *bad = g_strjoinv(to, parts);
    g_autoptr(GError) error = NULL;
    struct rig read;

    g_assert_false(rig_from_text(&read, bad, "x.conf", &error));
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    g_assert_true(error->domain == RIG_ERROR);
    g_assert_nonnull(strstr(error->message, says));
}

TEST(text_refused) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(6);
    struct rig rig = random_rig(rand);
    rig.cameras[0].k2 = 0.125;
    g_autofree char *text = rig_to_text(&rig);

    assert_refused(text, "k2=0.125", "k2=nan", "k2");
    assert_refused(text, "k2=0.125", "k2=inf", "k2");
    assert_refused(text, "k2=0.125", "k2=0.125x", "k2");
    assert_refused(text, "k2=0.125", "k2=", "k2");
    assert_refused(text, "k2=0.125", "k2=1;2", "k2");
    assert_refused(text, "k2=0.125", "", "k2");
    assert_refused(text, "k2=0.125", "k2=0.125\nk9=1", "k9");
    assert_refused(text, "width=160", "width=0", "width");
    assert_refused(text, "width=160", "width=1e9", "width");
    assert_refused(text, "width=160", "width=160.5", "width");
    assert_refused(text, "cameras=3", "cameras=4", "camera 3");
    assert_refused(text, "cameras=3", "cameras=2", "sections");
    assert_refused(text, "cameras=3", "cameras=257", "cameras");
    assert_refused(text, "cameras=3", "cameras=-1", "cameras");
    assert_refused(text, "calibration-1", "calibration-2", "version");
    assert_refused(text, "complete=yes", "complete=no", "short");
    assert_refused(text, "name=cam 1", "name=a name that is much too long to be a camera's",
                   "long");
    assert_refused(text, "axis=0;1;0", "axis=0;1;1", "axis");
    assert_refused(text, "axis=0;1;0", "axis=1;0;0", "perpendicular");
    assert_refused(text, "rotation=", "rotation=0;0;0;0;0;0;0;0;0\n#", "rotation");
    assert_refused(text, "[rig]", "[rig\001]", "x.conf");
}

BEFORE_TESTS {
    setlocale(LC_ALL, "");
}
