/* Laser sheets and sweeps from lines on planes of two heights, in simulated sweeps. */
#include "lib/deviate.h"
#include "lib/lasers_scene.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <string.h>

TEST(two_heights) {
    const struct sweep_poses poses = {
        .arcs = 3, .steps = 64, .span_deg = 2.5, .most = 800, .cameras = 2};
    struct laser_result found;
    struct scene *scene;
    struct sweep_errors errors;
    g_assert_true(ok(sweep_measure(1, 96, 0, &poses, 2, &found, &scene, ERR)));
    sweep_compare(scene, &poses, &found, &errors);
    g_test_message("angle %.4f°, offset %.4f mm, source %.3f mm, rms %.4f mm, %u steps",
                   errors.angle_deg, errors.offset_mm, errors.source_mm, found.rms_all_mm,
                   found.steps->len);
    g_assert_cmpfloat(errors.angle_deg, <, 0.03); /* bench_calibration has larger pictures */
    g_assert_cmpfloat(errors.offset_mm, <, 0.03);
    g_assert_cmpfloat(found.source_error_mm[0], <, 5);
    g_assert_cmpuint(found.steps->len, >, 50);
    laser_result_clear(&found);
    scene_free(scene);
}

TEST(one_height) {
    const struct sweep_poses poses = {
        .arcs = 1, .steps = 24, .span_deg = 2.5, .most = 400, .cameras = 1};
    struct laser_result found;
    struct scene *scene;
    g_autoptr(GError) error = NULL;
    g_assert_false(sweep_measure(1, 48, 0, &poses, 1, &found, &scene, &error));
    g_assert_error(error, LASER_ERROR, LASER_ERROR_DEGENERATE);
    g_assert_nonnull(strstr(error->message,
                            "sweep: the planes on which laser s0 is seen have heights "
                            "from 1.000 to 1.000 mm"));
    scene_free(scene);
}

static const char *const names[] = {"a.exr"};
static const struct laser_arc unknown = {0.01, 1};
static const struct rig_arc true_arc = {0.01, {0.002, -0.001}, {0.3, -0.2}};

/* Points of a sheet that is off, which the sweep turns by `turn` times what it is told; every
 * wrong_every-th is nowhere near it (0: none). */
static GArray *new_points(struct rig *rig, double turn, int wrong_every) {
    GArray *points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    struct vec3 out = rig_direction(SCENE_RAD(40), 0);
    *rig = (struct rig){.n_lasers = 2, .n_cameras = 1};
    rig->lasers[0] = (struct rig_laser){"one", vec3_scale(out, 480), vec3(0, 1, 0),
                                        vec3(-cos(SCENE_RAD(40)), 0, sin(SCENE_RAD(40))), 0};
    rig->lasers[1] = rig->lasers[0];
    struct rig_laser truth = rig->lasers[0];
    truth.position_mm = vec3_add(truth.position_mm, vec3(2, 0, -1));
    truth.axis = vec3_unit(vec3(0.003, 1, 0.002));
    truth.normal = vec3_unit(vec3_cross(truth.axis, vec3_scale(vec3(out.x, 0.001, out.z), -1)));
    truth.stretch = turn - 1;
    for (int i = 0; i < 3000; i++) {
        struct laser_point p = {.arc_rad = SCENE_RAD(30 * (i % 12)),
                                .sigma_mm = 0.01,
                                .point_mm =
                                    vec3(g_rand_double_range(rand, -30, 30),
                                         g_rand_double_range(rand, -30, 30), i & 1 ? 20 : 1)};
        p.sweep_rad = rig_laser_sweep_rad(&true_arc, &truth, p.arc_rad, p.point_mm);
        if (wrong_every > 0 && i % wrong_every == 0)
            p.sweep_rad += 0.02;
        g_array_append_val(points, p);
    }
    return points;
}

static gboolean fit_points(const struct rig *rig, const GArray *points, struct laser_result *ret,
                           GError **error) {
    return laser_fit(rig, (const struct laser_point *)(gpointer)points->data, (int)points->len,
                     &unknown, names, ret, error);
}

/* Exact points of a sheet that is off, and some that are nowhere near it. */
TEST(exact) {
    struct rig rig;
    struct laser_result found;
    g_autoptr(GArray) points = new_points(&rig, 1.01, 50);
    const gboolean fitted = ok(fit_points(&rig, points, &found, ERR));
    g_assert_true(fitted);
    g_assert_false(found.seen[1]);
    for (guint i = 0; i < points->len; i++) {
        const struct laser_point *p = &g_array_index(points, struct laser_point, i);
        g_assert_cmpint(found.rejected[i], ==, i % 50 == 0);
        double sweep =
            rig_laser_sweep_rad(&found.rig.arc, &found.rig.lasers[0], p->arc_rad, p->point_mm);
        if (i % 50)
            g_assert_cmpfloat_with_epsilon(sweep, p->sweep_rad, 1e-6);
    }
    /* The zero of the arc is the laser's own azimuth: only what is left is told. */
    g_assert_cmpfloat_with_epsilon(found.rig.arc.tilt_rad[0], 0.002, 1e-5);
    g_assert_cmpfloat_with_epsilon(found.rig.arc.centre_mm[1], -0.2, 1e-2);
    g_assert_cmpfloat_with_epsilon(found.rig.lasers[0].stretch, 0.01, 1e-4);
    laser_result_clear(&found);
}

/* A bent sheet is found as bent as it is, whichever way it is bent, and a flat one is flat. Its
 * error is that of the sheet, although the position along the beam is hardly known. */
TEST(bent) {
    static const double bends_rad[] = {0, 0.04, -0.01};
    for (gsize k = 0; k < G_N_ELEMENTS(bends_rad); k++) {
        struct rig rig;
        struct laser_result found;
        g_autoptr(GArray) points = new_points(&rig, 1.01, 0);
        g_autoptr(GRand) rand = g_rand_new_with_seed(4);
        double squares = 0;
        for (guint i = 0; i < points->len; i++) {
            struct laser_point *p = &g_array_index(points, struct laser_point, i);
            struct rig_laser truth = rig.lasers[0]; /* nearly, as far as the bend goes */
            truth.bend_rad = bends_rad[k];
            p->sweep_rad -= rig_laser_bent_rad(&true_arc, &truth, p->arc_rad, p->point_mm);
            p->sweep_rad += 2e-5 * deviate_sum(rand);
            p->noise_mm = 0.0096f; /* 2e-5 of 480 mm */
        }
        ok(fit_points(&rig, points, &found, ERR));
        const double found_rad = found.rig.lasers[0].bend_rad;
        g_test_message("bend %.5f ± %.5f, is %.5f; sheet ± %.4f mm, source ± %.2f mm, RMS %.4f "
                       "mm, expected %.4f",
                       found_rad, found.bend_error_rad[0], bends_rad[k], found.sheet_error_mm[0],
                       found.source_error_mm[0], found.rms_mm[0], found.expected_mm[0]);
        g_assert_cmpfloat(fabs(found_rad - bends_rad[k]), <, 4 * found.bend_error_rad[0] + 2e-4);
        g_assert_true((found_rad == 0) == (bends_rad[k] == 0));
        g_assert_cmpfloat(found.bend_error_rad[0], <, 1e-3);
        for (guint i = 0; i < points->len; i++) {
            const struct laser_point *p = &g_array_index(points, struct laser_point, i);
            const double sweep_rad =
                rig_laser_sweep_rad(&found.rig.arc, &found.rig.lasers[0], p->arc_rad, p->point_mm);
            squares += pow((sweep_rad - p->sweep_rad) / 2e-5, 2) / points->len;
        }
        g_assert_cmpfloat(squares, <, 1.1);
        g_assert_cmpfloat(found.sheet_error_mm[0], <, 0.2 * found.source_error_mm[0]);
        g_assert_cmpfloat(fabs(found.rms_mm[0] / found.expected_mm[0] - 1), <, 0.1);
        laser_result_clear(&found);
    }
}

/* Lines at one angle of the arc do not tell how the arc's axis stands: the laser's position and
 * zero are then known only as well as the axis was before, and are marked. The sheet is known. */
TEST(prior) {
    struct rig rig;
    struct laser_result all, one;
    g_autoptr(GArray) points = new_points(&rig, 1.01, 0);
    g_autoptr(GRand) rand = g_rand_new_with_seed(4);
    for (guint i = 0; i < points->len; i++)
        g_array_index(points, struct laser_point, i).sweep_rad += 2e-5 * deviate_sum(rand);
    ok(fit_points(&rig, points, &all, ERR));
    for (guint i = 0; i < points->len; i++) {
        struct laser_point *p = &g_array_index(points, struct laser_point, i);
        p->arc_rad = SCENE_RAD(60);
        p->sweep_rad =
            rig_laser_sweep_rad(&all.rig.arc, &all.rig.lasers[0], p->arc_rad, p->point_mm) +
            2e-5 * deviate_sum(rand);
    }
    ok(fit_points(&rig, points, &one, ERR));
    for (int k = 0; k < 2; k++) {
        const struct laser_result *found = k ? &one : &all;
        g_test_message("sheet ± %.4f mm, source ± %.2f mm, zero ± %.4f rad, prior %d%d%d%d",
                       found->sheet_error_mm[0], found->source_error_mm[0],
                       found->zero_error_rad[0], found->from_prior[0][0], found->from_prior[0][1],
                       found->from_prior[0][2], found->from_prior[0][3]);
        g_assert_true(found->from_prior[0][2] == k);
        g_assert_false(found->from_prior[0][3]);
        g_assert_cmpfloat(found->sheet_error_mm[0], <, 0.15);
    }
    g_assert_cmpfloat(one.zero_error_rad[0], >, 0.002); /* 1 mm at 480 mm */
    laser_result_clear(&all);
    laser_result_clear(&one);
}

/* What no file of a calibration may hold is refused with its cause. */
TEST(wrong_turn) {
    static const struct {
        double turn;
        const char *what;
    } cases[] = {{-0.98, "laser one: the direction of its sweep is reversed"},
                 {1.7, "laser one: a step of 1° of its sweep turns the sheet by 1.7"},
                 {0.4, "laser one: a step of 1° of its sweep turns the sheet by 0.4"}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct rig rig;
        struct laser_result found;
        g_autoptr(GArray) points = new_points(&rig, cases[i].turn, 0);
        g_autoptr(GError) error = NULL;
        g_assert_false(fit_points(&rig, points, &found, &error));
        g_assert_error(error, LASER_ERROR, LASER_ERROR_SWEEP);
        g_test_message("%s", error->message);
        g_assert_nonnull(strstr(error->message, cases[i].what));
        g_assert_nonnull(strstr(error->message, "steps_per_deg"));
        laser_result_clear(&found);
    }
}

/* Lines of the laser at 40° that are noted as those of another: one far from it is told by them
 * only, one next to it by where it is found. */
TEST(exchanged) {
    static const struct {
        double other_deg;
        const char *what;
    } cases[] = {{60, "lasers one and two are exchanged"},
                 {42, "of laser two: the two lasers are exchanged; exchange theta_deg"}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct rig rig;
        struct laser_result found;
        g_autoptr(GArray) points = new_points(&rig, 1.01, 50);
        g_autoptr(GError) error = NULL;
        const double deg = cases[i].other_deg;
        rig.lasers[0] = (struct rig_laser){"one", vec3_scale(rig_direction(SCENE_RAD(deg), 0), 480),
                                           vec3(0, 1, 0),
                                           vec3(-cos(SCENE_RAD(deg)), 0, sin(SCENE_RAD(deg))), 0};
        g_strlcpy(rig.lasers[1].name, "two", RIG_NAME);
        g_assert_false(fit_points(&rig, points, &found, &error));
        g_assert_error(error, LASER_ERROR, LASER_ERROR_MISTAKE);
        g_test_message("%s", error->message);
        g_assert_nonnull(strstr(error->message, cases[i].what));
        laser_result_clear(&found);
    }
}

/* The points of one height as cameras show them that take it for another: along their lines of
 * sight. */
static void put_height(const struct rig *rig, GArray *points, double is_mm, double said_mm) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(2);
    for (guint i = 0; i < points->len; i++) {
        struct laser_point *p = &g_array_index(points, struct laser_point, i);
        p->camera = (int)(i / 2) % rig->n_cameras;
        p->sweep_rad += g_rand_double_range(rand, -3e-5, 3e-5);
        const struct vec3 eye = rig_camera_centre_mm(&rig->cameras[p->camera]);
        if (p->point_mm.z != is_mm)
            continue;
        p->point_mm = vec3_add(
            eye, vec3_scale(vec3_sub(p->point_mm, eye), (said_mm - eye.z) / (is_mm - eye.z)));
        p->point_mm.z = said_mm;
    }
}

/* The height that the message tells after these words is that which is true. */
static void assert_height(const char *message, const char *words, double is_mm) {
    const char *at = strstr(message, words);
    double mm, error_mm;
    g_assert_nonnull(at);
    g_assert_cmpint(sscanf(at + strlen(words), "%lf ± %lf", &mm, &error_mm), ==, 2);
    g_assert_cmpfloat(fabs(mm - is_mm), <=, 4 * error_mm + 0.0005);
    g_assert_cmpfloat(error_mm, <, 0.1);
}

/* A plate of another height than was said is told with the true one if two cameras see it. One that
 * sees a laser from all sides tells that it or the other plate is wrong: (560 − 1) / (560 − 20) is
 * (560 − 4.11) / (560 − 23). If it sees each plate at one angle of the arc only, nothing tells. */
TEST(heights) {
    static const struct {
        int cameras;
        gboolean one_angle;
        double is_mm, said_mm;
        const char *what, * or ; /* NULL: it is not told */
    } cases[] = {
        {2, FALSE, 20, 20.4, "given as 20.4 mm, but the lines show ", NULL},
        {1, FALSE, 20, 23, "is not 23 mm, but ", "given as 1 mm, but "},
        {1, TRUE, 20, 23, NULL, NULL},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct rig rig;
        struct laser_result found;
        g_autoptr(GArray) all = new_points(&rig, 1.01, 50);
        g_autoptr(GArray) points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
        g_autoptr(GError) error = NULL;
        rig.n_cameras = cases[i].cameras;
        rig_camera_look_at(&rig.cameras[0], vec3(330, 20, 560), vec3(0, 0, 0));
        rig_camera_look_at(&rig.cameras[1], vec3(-200, 260, 560), vec3(0, 0, 0));
        for (guint k = 0; k < all->len / 2; k += cases[i].one_angle ? 1 : 7)
            if (!cases[i].one_angle || k % 12 == 2 || k % 12 == 3)
                g_array_append_val(points, g_array_index(all, struct laser_point, k));
        put_height(&rig, points, cases[i].is_mm, cases[i].said_mm);
        const gboolean fits = fit_points(&rig, points, &found, &error);
        g_test_message("%s", error ? error->message : "nothing told");
        g_assert_cmpint(fits, ==, cases[i].what == NULL);
        if (cases[i].what && !cases[i].or)
            assert_height(error->message, cases[i].what, cases[i].is_mm);
        if (cases[i].or) {
            g_assert_nonnull(strstr(error->message, ", or else the height of the plate of a.exr "));
            g_assert_nonnull(strstr(error->message, cases[i].what));
            g_assert_nonnull(strstr(error->message, cases[i].or));
        }
        laser_result_clear(&found);
    }
}

AFTER_TESTS {
    world_fixture_clean();
}
