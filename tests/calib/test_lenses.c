/*
 * Lens models from corners that this file's own formulas place: the derivatives of the projection
 * are its differences, each model is recovered within its error bars, the right one is chosen, a
 * narrow lens keeps the polynomial, a bend of the board is found, and the error bars hold for
 * boards that are bent differently in each picture.
 */
#include "base/work.h"
#include "cameras/bundle_private.h"
#include "cameras/cameras_private.h"
#include "geometry/rig.h"
#include "lib/deviate.h"
#include "lib/test.h"

#include <math.h>
#include <string.h>

#define WIDTH      640
#define HEIGHT     480
#define N_PICTURES 12
#define N_SEEDS    4
#define SIGMA_PX   0.05
#define BOARD      "10x7,square=25"

/* How a lens images x / z, y / z; k: k1 … k6, p1, p2 by OpenCV's manual, written anew. */
struct lens {
    const char *name;
    enum rig_lens model;
    double focal, k[6], p[2];
};

static void image(const struct lens *lens, const double v[3], double ret_px[2]) {
    const double *k = lens->k, x = v[0] / v[2], y = v[1] / v[2], r2 = x * x + y * y;
    double u, w;
    if (lens->model == RIG_LENS_FISHEYE) {
        const double t = atan(sqrt(r2));
        const double bent =
            t + k[0] * pow(t, 3) + k[1] * pow(t, 5) + k[2] * pow(t, 7) + k[3] * pow(t, 9);
        u = x * bent / sqrt(r2);
        w = y * bent / sqrt(r2);
    } else {
        double g = 1 + k[0] * r2 + k[1] * pow(r2, 2) + k[2] * pow(r2, 3);
        if (lens->model == RIG_LENS_RATIONAL)
            g /= 1 + k[3] * r2 + k[4] * pow(r2, 2) + k[5] * pow(r2, 3);
        u = x * g + 2 * lens->p[0] * x * y + lens->p[1] * (r2 + 2 * x * x);
        w = y * g + lens->p[0] * (r2 + 2 * y * y) + 2 * lens->p[1] * x * y;
    }
    ret_px[0] = lens->focal * u + 322;
    ret_px[1] = lens->focal * w + 237;
}

/* The corners of one board held before the lens: its middle towards a random point of the picture,
 * turned about two axes by up to 0.7. */
struct sagittas {
    double each_mm;   /* standard deviation, anew in each picture, across and down */
    double all_mm[2]; /* in all pictures, across and down */
};
static GArray *photograph(const struct lens *lens, const struct board *board, GRand *rand,
                          const struct sagittas *bent) {
    GArray *corners = g_array_new(FALSE, TRUE, sizeof(struct corner));
    const double half = tan(MIN(atan(WIDTH / 2.0 / lens->focal), 1.0));
    const double size = board->columns * board->square_mm;
    const double range = size / (2 * half) * g_rand_double_range(rand, 0.9, 1.6);
    const double a = g_rand_double_range(rand, -0.7, 0.7), b = g_rand_double_range(rand, -0.7, 0.7);
    const double c = g_rand_double_range(rand, -0.5, 0.5);
    const double at[2] = {g_rand_double_range(rand, -0.6, 0.6) * half * range,
                          g_rand_double_range(rand, -0.4, 0.4) * half * range};
    const double sag[2] = {bent->all_mm[0] + bent->each_mm * deviate_normal(rand),
                           bent->all_mm[1] + bent->each_mm * deviate_normal(rand)};
    for (int id = 0; id < board_n_corners(board); id++) {
        double mm[2], px[2];
        board_corner_mm(board, id, mm);
        const double across = mm[0] / (size / 2), down = mm[1] / (size / 2);
        const double z0 = sag[0] * (1 - across * across) + sag[1] * (1 - down * down);
        const double x0 = mm[0] * cos(c) - mm[1] * sin(c), y0 = mm[0] * sin(c) + mm[1] * cos(c);
        const double x1 = x0 * cos(a) + z0 * sin(a), z1 = z0 * cos(a) - x0 * sin(a);
        const double v[3] = {at[0] + x1, at[1] + y0 * cos(b) - z1 * sin(b),
                             range + y0 * sin(b) + z1 * cos(b)};
        if (v[2] < 0.15 * range)
            continue;
        image(lens, v, px);
        if (px[0] < 4 || px[0] > WIDTH - 5 || px[1] < 4 || px[1] > HEIGHT - 5)
            continue;
        const struct corner corner = {
            .id = id,
            .x_px = px[0] + SIGMA_PX * deviate_normal(rand),
            .y_px = px[1] + SIGMA_PX * deviate_normal(rand),
            .covariance_px2 = {{SIGMA_PX * SIGMA_PX, 0}, {0, SIGMA_PX * SIGMA_PX}}};
        g_array_append_val(corners, corner);
    }
    return corners;
}

struct found {
    struct bundle_camera camera;
    double held_out_px[RIG_LENSES], inflation, chi2; /* of fx, fy, cx, cy, a degree of freedom */
    double sag_mm[2];                                /* across and down; 0: the board is flat */
};

/* dᵀ C⁻¹ d / 4 of the focal lengths and the principal point, by Cholesky's factor. */
static double chi2(const struct lens *lens, const struct bundle_camera *camera) {
    const double truth[4] = {lens->focal, lens->focal, 322, 237};
    double l[4][4] = {0}, z[4], sum = 0;
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j <= i; j++) {
            double s = camera->covariance[i][j];
            for (int k = 0; k < j; k++)
                s -= l[i][k] * l[j][k];
            l[i][j] = i == j ? sqrt(s) : s / l[j][j];
        }
        z[i] = camera->intrinsics[i] - truth[i];
        for (int k = 0; k < i; k++)
            z[i] -= l[i][k] * z[k];
        z[i] /= l[i][i];
        sum += z[i] * z[i];
    }
    return sum / 4;
}

/* As cameras_calibrate_lens() does, from corners rather than pictures. given: RIG_LENSES: by
 * evidence. */
static struct found calibrate(const struct lens *lens, guint32 seed, const struct sagittas *bent,
                              enum rig_lens given) {
    struct cameras_task task = {.n_pictures = N_PICTURES,
                                .lens_given = given != RIG_LENSES,
                                .lens = given == RIG_LENSES ? RIG_LENS_POLYNOMIAL : given};
    struct bundle_camera cameras[RIG_MAX_CAMERAS] = {0};
    struct bundle_lay lays[N_PICTURES] = {0};
    struct bundle_stop stops[N_PICTURES] = {0};
    struct seen seen[N_PICTURES] = {0};
    struct cameras_work work = {.task = &task, .seen = seen, .free_boards = TRUE};
    struct found found = {0};
    g_autoptr(GError) error = NULL;
    GRand *rand = g_rand_new_with_seed(seed);
    g_assert_true(board_parse(&task.board, BOARD, NULL));
    work.nominal.n_cameras = 1;
    work.nominal.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    work.observations = g_array_new(FALSE, TRUE, sizeof(struct bundle_observation));
    work.bundle = (struct bundle){.cameras = cameras,
                                  .lays = lays,
                                  .stops = stops,
                                  .n_cameras = 1,
                                  .n_lays = N_PICTURES,
                                  .n_stops = N_PICTURES};
    for (int i = 0; i < N_PICTURES; i++) {
        stops[i].lay = i;
        seen[i] = (struct seen){.name = (char *)"corners",
                                .lay = i,
                                .stop = i,
                                .width = WIDTH,
                                .height = HEIGHT,
                                .corners = photograph(lens, &task.board, rand, bent)};
    }
    const gboolean ok = cameras_start_lens(&work, &error) && cameras_start_lays(&work, &error) &&
                        cameras_choose_lens(&work, &error) && cameras_refine(&work, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    found.camera = cameras[0];
    found.inflation = work.inflation[0];
    found.chi2 = chi2(lens, &cameras[0]);
    for (int i = 0; i < 2; i++) /* b₀ and b₂ at half the board's width */
        found.sag_mm[i] =
            -work.bundle.bend[2 * i] * pow(task.board.columns * task.board.square_mm / 2, 2);
    memcpy(found.held_out_px, work.held_out_px, sizeof found.held_out_px);
    for (int i = 0; i < N_PICTURES; i++) {
        g_clear_pointer(&seen[i].corners, g_array_unref);
        g_clear_pointer(&seen[i].set_aside, g_array_unref);
        g_free(seen[i].why);
    }
    g_array_unref(work.observations);
    g_rand_free(rand);
    return found;
}

static const struct lens lenses[] = {
    {"narrow", RIG_LENS_POLYNOMIAL, 1800, {-0.1, 0.2}, {0.0005, -0.001}},
    {"polynomial", RIG_LENS_POLYNOMIAL, 430, {-0.28, 0.09, -0.012}, {0.001, -0.0005}},
    {"rational", RIG_LENS_RATIONAL, 260, {0.9, 0.02, 0, 1.3, 0.3, 0.002}, {0.0005, -0.001}},
    {"rational alone", RIG_LENS_RATIONAL, 260, {-0.3, 2, 0.2, 0, 2.2, 1.2}, {0.0005, -0.001}},
    {"fisheye", RIG_LENS_FISHEYE, 230, {0.03, -0.025, 0.02, -0.007}, {0}},
};

/* rig_project() is the same formula as this file's, and rig_pixel_ray() its inverse. */
static void test_projection(gconstpointer data) {
    const struct lens *lens = data;
    const double *k = lens->k;
    struct rig_camera camera = {.width = WIDTH,
                                .height = HEIGHT,
                                .lens = (int)lens->model,
                                .fx_px = lens->focal,
                                .fy_px = lens->focal,
                                .cx_px = 322,
                                .cy_px = 237,
                                .k1 = k[0],
                                .k2 = k[1],
                                .k3 = k[2],
                                .k4 = k[3],
                                .k5 = k[4],
                                .k6 = k[5],
                                .p1 = lens->p[0],
                                .p2 = lens->p[1],
                                .rotation = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
    const double reach = MIN(WIDTH / 1.5 / lens->focal, 1.5);
    GRand *rand = g_rand_new_with_seed(5);
    int n = 0;
    for (int i = 0; i < 1000; i++) {
        const double v[3] = {g_rand_double_range(rand, -reach, reach),
                             g_rand_double_range(rand, -reach, reach), 1};
        double want[2], got[2];
        image(lens, v, want);
        if (want[0] < 0 || want[0] >= WIDTH || want[1] < 0 || want[1] >= HEIGHT ||
            !rig_project(&camera, vec3(v[0], v[1], v[2]), &got[0], &got[1]))
            continue;
        g_assert_cmpfloat_with_epsilon(got[0], want[0], 1e-9);
        g_assert_cmpfloat_with_epsilon(got[1], want[1], 1e-9);
        const struct vec3 ray = rig_pixel_ray(&camera, want[0], want[1]);
        g_assert_cmpfloat_with_epsilon(ray.x / ray.z, v[0], 1e-8);
        g_assert_cmpfloat_with_epsilon(ray.y / ray.z, v[1], 1e-8);
        n++;
    }
    g_assert_cmpint(n, >, 300);
    g_rand_free(rand);
}

/* bundle_image()'s derivatives are the central differences of its own positions, by every
 * parameter, at small rotations and at large ones; the positions are this file's. */
static void test_slopes(gconstpointer data) {
    const struct lens *lens = data;
    const double *k = lens->k;
    GRand *rand = g_rand_new_with_seed(6);
    for (int n = 0; n < 40; n++) {
        const double turned = n % 2 ? 1 : 1e-3;
        double intrinsics[] = {lens->focal, lens->focal, 322,        237,  k[0], k[1],
                               k[2],        lens->p[0],  lens->p[1], k[3], k[4], k[5]};
        double pose[6], lay[6], angle = g_rand_double_range(rand, -3, 3), px[2], want[2];
        struct bundle_camera camera = {.lens = lens->model};
        struct bundle_lay board = {0};
        struct bundle_slopes slopes;
        const double mm[2] = {g_rand_double_range(rand, -90, 90),
                              g_rand_double_range(rand, -60, 60)};
        if (lens->model == RIG_LENS_FISHEYE) { /* k1, k2, k3, k4 lie apart */
            intrinsics[9] = k[3];
            intrinsics[10] = intrinsics[11] = 0;
        }
        for (int i = 0; i < 9; i++)
            camera.rotation[i] = board.rotation[i] = i % 4 == 0;
        for (int i = 0; i < 6; i++) {
            pose[i] = i < 3 ? turned * g_rand_double_range(rand, -0.3, 0.3)
                            : g_rand_double_range(rand, -20, 20);
            lay[i] = i < 3 ? turned * g_rand_double_range(rand, -0.3, 0.3)
                           : g_rand_double_range(rand, -20, 20);
        }
        lay[5] += 900; /* before the camera */
        double bend[3];
        for (int i = 0; i < 3; i++)
            bend[i] = g_rand_double_range(rand, -1e-4, 1e-4);
        double wobble[BUNDLE_WOBBLE];
        for (int i = 0; i < BUNDLE_WOBBLE; i++)
            wobble[i] = turned * g_rand_double_range(rand, -0.05, 0.05);
        double *const blocks[] = {intrinsics, pose, lay, &angle, bend, wobble};
        const int sizes[] = {BUNDLE_INTRINSICS, 6, 6, 1, 3, BUNDLE_WOBBLE};
        struct bundle_parameters at = {intrinsics, pose, lay, angle, bend, wobble, n};
        g_assert_true(bundle_image(&camera, &board, &at, mm, px, &slopes));
        const double *const found[] = {slopes.lens[0], slopes.pose[0], slopes.lay[0],
                                       slopes.angle,   slopes.bend[0], slopes.wobble[0]};
        for (int b = 0; b < 6; b++)
            for (int i = 0; i < sizes[b]; i++) {
                const double was = blocks[b][i], step = 1e-6 * MAX(fabs(was), 1);
                double more[2], less[2];
                blocks[b][i] = was + step;
                at.angle = angle;
                g_assert_true(bundle_image(&camera, &board, &at, mm, more, NULL));
                blocks[b][i] = was - step;
                at.angle = angle;
                g_assert_true(bundle_image(&camera, &board, &at, mm, less, NULL));
                blocks[b][i] = was;
                at.angle = angle;
                for (int c = 0; c < 2; c++)
                    g_assert_cmpfloat_with_epsilon(found[b][c * sizes[b] + i],
                                                   (more[c] - less[c]) / (2 * step),
                                                   1e-5 * (1 + fabs(found[b][c * sizes[b] + i])));
            }
        /* With a wobble the point is where the rig's own functions see it. */
        struct rig rig = {0};
        double tilt_rad[2], without[2];
        bundle_wobble(wobble, &rig.wobble);
        rig_wobble_tilt(&rig.wobble, n, tilt_rad);
        g_assert_true(bundle_image(&camera, &board, &at, mm, px, NULL));
        at.wobble = NULL;
        struct bundle_camera moved = camera;
        rig.n_cameras = 1;
        memcpy(rig.cameras[0].rotation.m, camera.rotation, sizeof camera.rotation);
        bundle_turn(moved.rotation, pose); /* the camera's whole rotation, then tilted back */
        memcpy(rig.cameras[0].rotation.m, moved.rotation, sizeof moved.rotation);
        rig_at(&rig, n, &rig);
        memcpy(moved.rotation, rig.cameras[0].rotation.m, sizeof moved.rotation);
        const double still[6] = {0, 0, 0, pose[3], pose[4], pose[5]};
        at.pose = still;
        g_assert_true(bundle_image(&moved, &board, &at, mm, without, NULL));
        g_assert_cmpfloat_with_epsilon(px[0], without[0], 1e-7);
        g_assert_cmpfloat_with_epsilon(px[1], without[1], 1e-7);
        at.pose = pose;
        /* Without rotations: t_z = h, the turntable turns the board, and its bend is along z. */
        memset(pose, 0, sizeof pose);
        memset(lay, 0, sizeof *lay * 3);
        g_assert_true(bundle_image(&camera, &board, &at, mm, px, NULL));
        const double x = mm[0] + lay[3], y = mm[1] + lay[4];
        image(lens,
              (const double[]){x * cos(angle) - y * sin(angle), x * sin(angle) + y * cos(angle),
                               lay[5] + bend[0] * mm[0] * mm[0] + bend[1] * mm[0] * mm[1] +
                                   bend[2] * mm[1] * mm[1]},
              want);
        g_assert_cmpfloat_with_epsilon(px[0], want[0], 1e-9);
        g_assert_cmpfloat_with_epsilon(px[1], want[1], 1e-9);
    }
    g_rand_free(rand);
}

/* A fisheye of k = 0 images 60° off and 120° off its axis at radii of π/3 and 2π/3 focal lengths;
 * with k1 = −0.1 its radius stops growing where 1 = 0.3 θ². */
TEST(fisheye) {
    struct rig_camera camera = {.lens = RIG_LENS_FISHEYE,
                                .fx_px = 300,
                                .fy_px = 300,
                                .rotation = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
    double x, y;
    for (int i = 0; i < 3; i++) {
        const double theta = i * G_PI / 3;
        g_assert_true(rig_project(&camera, vec3(0, sin(theta), cos(theta)), &x, &y));
        g_assert_cmpfloat_with_epsilon(x, 0, 1e-9);
        g_assert_cmpfloat_with_epsilon(y, 300 * theta, 1e-9);
        const struct vec3 ray = rig_pixel_ray(&camera, x, y);
        g_assert_cmpfloat_with_epsilon(ray.y, sin(theta), 1e-11);
        g_assert_cmpfloat_with_epsilon(ray.z, cos(theta), 1e-11);
    }
    camera.k1 = -0.1;
    const double fold = sqrt(1 / 0.3);
    g_assert_true(rig_project(&camera, vec3(sin(fold - 0.01), 0, cos(fold - 0.01)), &x, &y));
    g_assert_false(rig_project(&camera, vec3(sin(fold + 0.01), 0, cos(fold + 0.01)), &x, &y));
}

/* A fisheye and its covariance come back from a file bit for bit; a polynomial's file has no key
 * that an earlier version does not know. */
TEST(file) {
    g_autoptr(GError) error = NULL;
    struct rig rig = {.id = "x", .n_cameras = 1};
    struct rig_camera *camera = &rig.cameras[0];
    *camera = (struct rig_camera){.name = "cam",
                                  .width = WIDTH,
                                  .height = HEIGHT,
                                  .fx_px = 300,
                                  .fy_px = 301,
                                  .response = 1,
                                  .rotation = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
    g_autoptr(Calibration) polynomial = calibration_new(&rig);
    polynomial->cameras[0].known = TRUE;
    g_autofree char *old = calibration_to_text(polynomial);
    g_assert_null(strstr(old, "lens="));
    g_assert_null(strstr(old, "k4="));
    g_assert_null(strstr(old, "further_covariance="));
    camera->lens = RIG_LENS_FISHEYE;
    camera->k4 = 0.1 / 3;
    g_autoptr(Calibration) fisheye = calibration_new(&rig);
    struct calibration_camera *errors = &fisheye->cameras[0];
    errors->known = TRUE;
    errors->covariance[0][0] = 4;
    errors->further_covariance[0][0] = 0.1 / 7;
    errors->further_covariance[0][CALIBRATION_K4] = 1e-3;
    g_autofree char *text = calibration_to_text(fisheye);
    g_autoptr(Calibration) back = calibration_from_text(text, "x", &error);
    g_assert_no_error(error);
    g_assert_cmpmem(&back->rig.cameras[0], sizeof *camera, camera, sizeof *camera);
    g_assert_cmpmem(back->cameras, sizeof *errors, errors, sizeof *errors);
    errors->further_covariance[0][0] = 1; /* more than √(4 · 1e-3) */
    g_autofree char *bad = calibration_to_text(fisheye);
    g_assert_null(calibration_from_text(bad, "x", &error));
    g_assert_nonnull(strstr(error->message, "is not a covariance"));
}

static const struct sagittas flat = {0};

/* A flat board that is taken for a bent one (one in six, if differences of losses were normal) is
 * taken for a hardly bent one. */
static void test_recovered(gconstpointer data) {
    const struct lens *lens = data;
    double sum = 0, inflation = 0;
    int n_bent = 0;
    for (guint32 seed = 1; seed <= N_SEEDS; seed++) {
        const struct found found = calibrate(lens, seed, &flat, lens->model);
        n_bent += found.sag_mm[0] != 0;
        g_assert_cmpfloat(hypot(found.sag_mm[0], found.sag_mm[1]), <, 0.1);
        sum += found.chi2 / N_SEEDS;
        inflation += found.inflation / N_SEEDS;
        g_assert_cmpfloat(found.chi2, <, 6);
    }
    g_test_message("%s: chi2 %.2f a degree of freedom, variance inflated by %.2f", lens->name, sum,
                   inflation);
    g_assert_cmpint(n_bent, <=, N_SEEDS / 2);
    g_assert_cmpfloat(sum, <, 1.8);
    g_assert_cmpfloat(sum, >, 0.4);
    g_assert_cmpfloat(inflation, <, 1.3);
}

static void test_chosen(gconstpointer data) {
    const struct lens *lens = data;
    const struct found found = calibrate(lens, 101, &flat, RIG_LENSES);
    g_test_message("%s: %s, held out %.4f (polynomial) %.4f (rational) %.4f px (fisheye)",
                   lens->name, rig_lens_name(found.camera.lens), found.held_out_px[0],
                   found.held_out_px[1], found.held_out_px[2]);
    g_assert_cmpint(found.camera.lens, ==, lens->model);
    g_assert_cmpfloat(found.chi2, <, 6);
}

/* The boards' sagitta of 2 mm moves corners by pixels, the same way in the whole picture. */
static void test_bent(gconstpointer data) {
    const struct lens *lens = data;
    double sum = 0, inflation = 0;
    for (guint32 seed = 201; seed < 201 + N_SEEDS; seed++) {
        const struct found found =
            calibrate(lens, seed, &(const struct sagittas){.each_mm = 2}, lens->model);
        sum += found.chi2 / N_SEEDS;
        inflation += found.inflation / N_SEEDS;
    }
    g_test_message("%s: chi2 %.2f a degree of freedom, variance inflated by %.2f", lens->name, sum,
                   inflation);
    g_assert_cmpfloat(sum, <, 2.5);
    g_assert_cmpfloat(sum, >, 0.3);
    g_assert_cmpfloat(inflation, >, 2);
}

/* One board that is bent in the same way in all pictures: its bend is found, and the lens is as if
 * it were flat. */
static void test_one_bend(gconstpointer data) {
    static const struct sagittas bent = {.all_mm = {0.8, -0.5}};
    const struct lens *lens = data;
    double sum = 0, inflation = 0;
    for (guint32 seed = 301; seed < 301 + N_SEEDS; seed++) {
        const struct found found = calibrate(lens, seed, &bent, lens->model);
        sum += found.chi2 / N_SEEDS;
        inflation += found.inflation / N_SEEDS;
        g_test_message("seed %u: sagitta %.3f %.3f mm, chi2 %.2f, inflated by %.2f", seed,
                       found.sag_mm[0], found.sag_mm[1], found.chi2, found.inflation);
        g_assert_cmpfloat_with_epsilon(found.sag_mm[0], bent.all_mm[0], 0.1);
        g_assert_cmpfloat_with_epsilon(found.sag_mm[1], bent.all_mm[1], 0.1);
    }
    g_test_message("%s: chi2 %.2f a degree of freedom, variance inflated by %.2f", lens->name, sum,
                   inflation);
    g_assert_cmpfloat(sum, <, 1.8);
    g_assert_cmpfloat(sum, >, 0.4);
    g_assert_cmpfloat(inflation, <, 2);
}

BEFORE_TESTS {
    work_use_one_blas_thread(); /* as cameras_calibrate_lens() does */
    for (gsize i = 0; i < G_N_ELEMENTS(lenses); i++) {
        const struct lens *lens = &lenses[i];
        g_autofree char *projection = g_strdup_printf("/lenses/projection/%s", lens->name);
        g_autofree char *recovered = g_strdup_printf("/lenses/recovered/%s", lens->name);
        g_autofree char *chosen = g_strdup_printf("/lenses/chosen/%s", lens->name);
        g_autofree char *bent = g_strdup_printf("/lenses/bent boards/%s", lens->name);
        g_autofree char *one = g_strdup_printf("/lenses/one bend/%s", lens->name);
        g_autofree char *slopes = g_strdup_printf("/lenses/slopes/%s", lens->name);
        g_test_add_data_func(projection, lens, test_projection);
        g_test_add_data_func(slopes, lens, test_slopes);
        g_test_add_data_func(recovered, lens, test_recovered);
        if (!g_str_equal(lens->name, "rational")) /* a fisheye predicts that as well */
            g_test_add_data_func(chosen, lens, test_chosen);
        if (lens->model == RIG_LENS_FISHEYE)
            g_test_add_data_func(bent, lens, test_bent);
        if (g_str_equal(lens->name, "polynomial") || lens->model == RIG_LENS_FISHEYE)
            g_test_add_data_func(one, lens, test_one_bend);
    }
}
