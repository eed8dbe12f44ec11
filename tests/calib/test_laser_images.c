/*
 * mesorig calibrate laser --images, as a shell sees it: the plane of a laser that stands still,
 * from photographs of a board. The photographs are computed here with a geometry of their own: a
 * pinhole with a bent lens, the board's print on a plane, and a sheet of red light whose brightness
 * on the board falls with the distance from a plane. The true plane is known.
 *
 * BUILD/bin/test_laser_images --print compares the errors of eight sets of photographs with the
 * error bars, and with those of plain least squares that is told the true poses of the boards.
 */
#include "calibration/calibration.h"
#include "laser/laser_plane.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define MESORIG BUILD_DIR "/bin/mesorig"
#define WIDTH   720
#define HEIGHT  540
#define PIXELS  (WIDTH * HEIGHT)
#define SAMPLES 3 /* a pixel, along each side */
#define CHARUCO "9x7,square=20,marker=14,dictionary=4x4_50"
#define CHESS   "9x7,square=20"
#define FOCAL   820.0
#define CX      367.3
#define CY      262.1
#define K1      -0.15
#define K2      0.06

/* The sheet: n·x = d in the camera's frame. */
static const double sheet[4] = {0.8829475929, -0.0601, 0.4656, 229.7};

struct pose { /* camera = rotation · board + shift */
    double rotation[3][3], shift[3];
};

struct scene {
    const char *board;
    double laser; /* brightest light of the laser, over that of the room */
    double noise; /* standard deviation of a pixel, 1 is white */
    double speckle;
    double plane[4];
    gboolean grey;
};

static const struct scene usual = {CHARUCO, 0.5, 0.004, 0.1, {0}, FALSE};

static void true_plane(double ret[4]) {
    const double length = sqrt(sheet[0] * sheet[0] + sheet[1] * sheet[1] + sheet[2] * sheet[2]);
    for (int k = 0; k < 4; k++)
        ret[k] = sheet[k] / length;
}

static struct board parse(const char *spec) {
    struct board board;
    g_assert_true(ok(board_parse(&board, spec, ERR)));
    return board;
}

/* Turned about z by `turn`, then leaning about an axis in the picture's plane; the board faces the
 * camera, whose y points down. */
static struct pose pose_of(double turn, double lean, double azimuth, double x, double y, double z) {
    const double c = cos(turn), s = sin(turn), a[3] = {cos(azimuth), sin(azimuth), 0};
    const double flat[3][3] = {{c, -s, 0}, {-s, -c, 0}, {0, 0, -1}};
    struct pose pose = {.shift = {x, y, z}};
    for (int k = 0; k < 3; k++) { /* Rodrigues */
        const double v[3] = {flat[0][k], flat[1][k], flat[2][k]};
        const double along = a[0] * v[0] + a[1] * v[1];
        const double across[3] = {a[1] * v[2], -a[0] * v[2], a[0] * v[1] - a[1] * v[0]};
        for (int i = 0; i < 3; i++)
            pose.rotation[i][k] =
                v[i] * cos(lean) + across[i] * sin(lean) + a[i] * along * (1 - cos(lean));
    }
    return pose;
}

static struct pose random_pose(GRand *rand) {
    return pose_of(g_rand_double_range(rand, 0.2, 0.8), g_rand_double_range(rand, 0.1, 0.7),
                   g_rand_double_range(rand, 0, 2 * G_PI), g_rand_double_range(rand, -15, 15),
                   g_rand_double_range(rand, -15, 15), g_rand_double_range(rand, 330, 450));
}

/* Normal deviates by Box and Muller. */
static double normal(GRand *rand) {
    return sqrt(-2 * log(1 - g_rand_double(rand))) * cos(2 * G_PI * g_rand_double(rand));
}

/* Directions x / z, y / z of the samples of a photograph: in each row those of its pixels, n each.
 * They are the same in all photographs, and are computed once. */
static const double *sample_rays(void) {
    static double *rays;
    if (rays)
        return rays;
    rays = g_new(double, 2 * SAMPLES * SAMPLES * PIXELS);
    for (int i = 0; i < SAMPLES * SAMPLES * PIXELS; i++) {
        const int k = i % (SAMPLES * SAMPLES), pixel = i / (SAMPLES * SAMPLES);
        const double u = (pixel % WIDTH + (k % SAMPLES + 0.5) / SAMPLES - 0.5 - CX) / FOCAL;
        const int row = k / SAMPLES;
        const double v = (pixel / WIDTH + (row + 0.5) / SAMPLES - 0.5 - CY) / FOCAL;
        double a = u, b = v; /* x' = x (1 + k1 r² + k2 r⁴), inverted */
        for (int step = 0; step < 8; step++) {
            const double rr = a * a + b * b, bend = 1 + K1 * rr + K2 * rr * rr;
            a = u / bend;
            b = v / bend;
        }
        rays[2 * i] = a;
        rays[2 * i + 1] = b;
    }
    return rays;
}

/* R, G, B of a photograph, linear. lit: with the laser. */
static float *take(const struct scene *scene, const struct pose *pose, gboolean lit, guint32 seed) {
    const struct board board = parse(scene->board);
    const int n = WIDTH * SAMPLES * SAMPLES;
    const double *rays = sample_rays();
    g_autofree double *at = g_new(double, 2 * n), *sheet_mm = g_new(double, n);
    g_autofree float *printed = g_new(float, n);
    float *rgb = g_new(float, 3 * PIXELS);
    GRand *rand = g_rand_new_with_seed(seed);
    double plane[4];
    true_plane(plane);
    if (scene->plane[3] != 0)
        memcpy(plane, scene->plane, sizeof plane);
    const double(*r)[3] = pose->rotation;
    const double *t = pose->shift;
    const double facing = r[0][2] * t[0] + r[1][2] * t[1] + r[2][2] * t[2];
    for (int y = 0; y < HEIGHT; y++) {
        for (int i = 0; i < n; i++) {
            const double a = rays[2 * (y * n + i)], b = rays[2 * (y * n + i) + 1];
            const double far = facing / (r[0][2] * a + r[1][2] * b + r[2][2]);
            const double p[3] = {far * a, far * b, far};
            const double d[3] = {p[0] - t[0], p[1] - t[1], p[2] - t[2]};
            at[2 * i] = r[0][0] * d[0] + r[1][0] * d[1] + r[2][0] * d[2];
            at[2 * i + 1] = r[0][1] * d[0] + r[1][1] * d[1] + r[2][1] * d[2];
            sheet_mm[i] = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] - plane[3];
        }
        board_values(&board, at, n, printed);
        for (int x = 0; x < WIDTH; x++) {
            double room = 0, line = 0;
            for (int k = 0; k < SAMPLES * SAMPLES; k++) {
                const int i = x * SAMPLES * SAMPLES + k;
                const gboolean on = fabs(at[2 * i]) < 100 && fabs(at[2 * i + 1]) < 80;
                const double albedo = printed[i] >= 0 ? 0.05 + 0.8 * (double)printed[i]
                                      : on            ? 0.85
                                                      : 0.15;
                room += albedo / (SAMPLES * SAMPLES);
                if (lit && fabs(sheet_mm[i]) < 12) /* further away exp() is 0 */
                    line += albedo * exp(-sheet_mm[i] * sheet_mm[i] / (2 * 0.3 * 0.3)) /
                            (SAMPLES * SAMPLES);
            }
            static const double red[3] = {1, 0.05, 0.02}, warm[3] = {0.55, 0.5, 0.4};
            line *= lit ? scene->laser * (1 + scene->speckle * normal(rand)) : 0;
            float *to = rgb + (gsize)3 * (gsize)(y * WIDTH + x);
            for (int c = 0; c < 3; c++)
                to[c] = (float)(scene->grey
                                    ? 0.5 * room + line + scene->noise * normal(rand)
                                    : warm[c] * room + red[c] * line + scene->noise * normal(rand));
            if (scene->grey)
                to[1] = to[2] = to[0];
        }
    }
    g_rand_free(rand);
    return rgb;
}

/* As a portable pixmap of 8 bits in sRGB. */
static void write_photograph(const char *folder, int i, const float *rgb) {
    g_autofree char *name = g_strdup_printf("%02d.ppm", i);
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autoptr(GString) file = g_string_sized_new(3 * PIXELS + 32);
    g_string_printf(file, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
    for (gsize k = 0; k < 3 * PIXELS; k++) {
        const double v = CLAMP((double)rgb[k], 0, 1);
        const double code = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
        g_string_append_c(file, (char)(guint8)lround(255 * code));
    }
    g_assert_true(g_file_set_contents(path, file->str, (gssize)file->len, NULL));
}

static struct rig_camera true_camera(void) {
    return (struct rig_camera){.name = "camera",
                               .width = WIDTH,
                               .height = HEIGHT,
                               .fx_px = FOCAL,
                               .fy_px = FOCAL,
                               .cx_px = CX,
                               .cy_px = CY,
                               .k1 = K1,
                               .k2 = K2,
                               .rotation = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
                               .response = 1};
}

struct test {
    char *folder, *lit, *dark, *lens, *output, *plane;
};

static void begin(struct test *test) {
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    test->folder = g_dir_make_tmp("mesorig-laser-XXXXXX", NULL);
    test->lit = g_build_filename(test->folder, "lit", NULL);
    test->dark = g_build_filename(test->folder, "dark", NULL);
    test->lens = g_build_filename(test->folder, "lens.calibration", NULL);
    test->output = g_build_filename(test->folder, "scanner.calibration", NULL);
    test->plane = g_build_filename(test->folder, "plane.txt", NULL);
    g_assert_cmpint(g_mkdir(test->lit, 0700), ==, 0);
    g_assert_cmpint(g_mkdir(test->dark, 0700), ==, 0);
    rig.cameras[0] = true_camera();
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "by the test", 9, "", NULL);
    g_assert_true(ok(calibration_write(calibration, test->lens, ERR)));
}

static void end(struct test *test) {
    remove_tree(test->folder);
    g_free(test->folder);
    g_free(test->lit);
    g_free(test->dark);
    g_free(test->lens);
    g_free(test->output);
    g_free(test->plane);
}

static gboolean is_printing; /* a table, and nothing else */

/* Runs the command; what it says, on both outputs. */
static char *run(const struct test *test, const char *board, gboolean pairs, int *ret_code) {
    const char *arguments[16] = {MESORIG,      "calibrate", "laser",     "--images", test->lit,
                                 "--board",    board,       "-c",        test->lens, "-o",
                                 test->output, "--plane",   test->plane, NULL};
    char *out = NULL;
    g_autofree char *err = NULL;
    if (pairs) {
        arguments[13] = "--dark-images";
        arguments[14] = test->dark;
    }
    *ret_code = process_run(arguments, &out, &err);
    char *both = g_strconcat(out, err, NULL);
    g_free(out);
    if (!is_printing)
        g_test_message("%s", both);
    return both;
}

/* The table for NumPy: 24 numbers. */
static void read_table(const struct test *test, double ret[24]) {
    g_autofree char *text = NULL;
    int n = 0;
    g_assert_true(g_file_get_contents(test->plane, &text, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (char **line = lines; *line; line++) {
        if (**line == '#' || **line == '\0')
            continue;
        char *at = *line;
        for (int k = 0; k < 4; k++) {
            g_assert_cmpint(n, <, 24);
            ret[n++] = g_ascii_strtod(at, &at);
        }
    }
    g_assert_cmpint(n, ==, 24);
}

/* Deviation of a plane from the true one: at a point of it, and of its normal. */
static void deviation(const double found[4], const double point[3], double *ret_mm,
                      double *ret_rad) {
    double plane[4], cosine = 0, at = 0;
    true_plane(plane);
    for (int k = 0; k < 3; k++) {
        cosine += plane[k] * found[k];
        at += plane[k] * point[k];
    }
    *ret_mm = fabs(at - plane[3]);
    *ret_rad = acos(MIN(fabs(cosine), 1));
}

/* The plane is within its error bars, which are small. */
static void expect_plane(const struct test *test, double max_mm, double most_deg) {
    double t[24], off_mm, off_rad;
    g_autoptr(GError) error = NULL;
    read_table(test, t);
    deviation(t, t + 20, &off_mm, &off_rad);
    const double tilt = sqrt(t[4] + t[9] + t[14]); /* trace of the normal's covariance */
    g_test_message("off by %.4f ± %.4f mm and %.4f ± %.4f°", off_mm, t[23], off_rad * 180 / G_PI,
                   tilt * 180 / G_PI);
    g_assert_cmpfloat(off_mm, <, 3.5 * t[23]);
    g_assert_cmpfloat(off_rad, <, 3.5 * tilt);
    g_assert_cmpfloat(off_mm, <, max_mm);
    g_assert_cmpfloat(off_rad * 180 / G_PI, <, most_deg);
    g_assert_cmpfloat(t[23], <, max_mm);
    /* The calibration file has the same sheet. */
    g_autoptr(Calibration) calibration = calibration_read(test->output, &error);
    g_assert_no_error(error);
    g_assert_cmpint(calibration->rig.n_lasers, ==, 1);
    g_assert_true(calibration->lasers[0].known);
    const struct rig_laser *laser = &calibration->rig.lasers[0];
    const struct rig_plane plane = rig_laser_sheet(NULL, laser, 0, 0);
    g_assert_cmpint(laser->fixed, ==, 1);
    g_assert_cmpfloat_with_epsilon(plane.normal.x, t[0], 1e-9);
    g_assert_cmpfloat_with_epsilon(plane.normal.y, t[1], 1e-9);
    g_assert_cmpfloat_with_epsilon(plane.normal.z, t[2], 1e-9);
    g_assert_cmpfloat_with_epsilon(plane.offset_mm, t[3], 1e-6);
    g_assert_true(g_key_file_has_group(calibration->extra, "laser plane 0"));
}

static void take_all(const struct test *test, const struct scene *scene, int n, gboolean pairs,
                     guint32 seed) {
    GRand *rand = g_rand_new_with_seed(seed);
    for (int i = 0; i < n; i++) {
        const struct pose pose = random_pose(rand);
        g_autofree float *lit = take(scene, &pose, TRUE, seed + (guint32)i);
        write_photograph(test->lit, i, lit);
        if (!pairs)
            continue;
        g_autofree float *dark = take(scene, &pose, FALSE, seed + 100 + (guint32)i);
        write_photograph(test->dark, i, dark);
    }
    g_rand_free(rand);
}

TEST(colour) {
    struct test test;
    int code;
    begin(&test);
    take_all(&test, &usual, 6, FALSE, 1);
    g_autofree char *said = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 0);
    g_assert_nonnull(strstr(said, "laser laser: 6 photographs"));
    expect_plane(&test, 0.05, 0.1);
    /* A photograph whose laser has moved is left out. */
    struct scene moved = usual;
    true_plane(moved.plane);
    moved.plane[3] += 3;
    const struct pose pose = pose_of(0.1, 0.4, 1, 0, 0, 400);
    g_autofree float *lit = take(&moved, &pose, TRUE, 77);
    write_photograph(test.lit, 6, lit);
    g_autofree char *again = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 0);
    g_assert_nonnull(strstr(again, "laser laser: 6 photographs"));
    g_assert_nonnull(strstr(again, "06.ppm: its line is 3.0"));
    expect_plane(&test, 0.05, 0.1);
    end(&test);
}

/* A chessboard, on which the line hides corners, photographed with and without the laser, in grey.
 */
TEST(pairs) {
    struct scene scene = usual;
    struct test test;
    int code;
    scene.board = CHESS;
    scene.grey = TRUE;
    begin(&test);
    take_all(&test, &scene, 5, TRUE, 20);
    g_autofree char *said = run(&test, CHESS, TRUE, &code);
    g_assert_cmpint(code, ==, 0);
    g_assert_nonnull(strstr(said, "laser laser: 5 photographs"));
    expect_plane(&test, 0.05, 0.1);
    g_autofree char *first = g_build_filename(test.dark, "02.ppm", NULL);
    g_unlink(first);
    g_autofree char *missing = run(&test, CHESS, TRUE, &code);
    g_assert_cmpint(code, ==, 1);
    g_assert_nonnull(strstr(missing, "there is no photograph 02.ppm without the laser"));
    end(&test);
}

/* The lens from the photographs without the laser: its errors are in the plane's. */
TEST(lens) {
    struct test test;
    int code;
    g_autofree char *out = NULL, *err = NULL;
    begin(&test);
    take_all(&test, &usual, 9, TRUE, 40);
    const char *const arguments[] = {MESORIG,   "calibrate", "cameras", "--images", test.dark,
                                     "--board", CHARUCO,     "-o",      test.lens,  NULL};
    g_unlink(test.lens);
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 0);
    g_test_message("%s%s", out, err);
    g_assert_null(strstr(out, "the board seems to have"));
    /* A ChArUco board of two rows fewer than said. */
    g_autofree char *other = g_build_filename(test.folder, "rows.calibration", NULL);
    g_autofree char *rows =
        process_mesorig(0,
                        "calibrate cameras --images %s -b 9x9,square=20,marker=14,"
                        "dictionary=4x4_50 -o %s",
                        test.dark, other);
    assert_has(rows, "the board seems to have 7 rows of squares, not 9");
    g_autofree char *said = run(&test, CHARUCO, TRUE, &code);
    g_assert_cmpint(code, ==, 0);
    g_assert_nonnull(strstr(said, "9 photographs"));
    expect_plane(&test, 1, 0.5);
    end(&test);
}

TEST(refused) {
    struct test test;
    int code;
    begin(&test);
    /* One place: the plane is undetermined. */
    for (int i = 0; i < 4; i++) {
        const struct pose pose = pose_of(0.1 + 0.001 * i, 0.3, 1, 0.1 * i, 0, 400);
        g_autofree float *lit = take(&usual, &pose, TRUE, (guint32)i);
        write_photograph(test.lit, i, lit);
    }
    g_autofree char *parallel = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 1);
    g_assert_nonnull(strstr(parallel, "boards are at 0."));
    g_assert_nonnull(strstr(parallel, "mm (RMS) from one straight line, which does not determine"));
    g_assert_false(g_file_test(test.output, G_FILE_TEST_EXISTS));
    /* Parallel boards at two distances determine it. */
    for (int i = 0; i < 4; i++) {
        const struct pose pose = pose_of(0.1, 0.3, 1, 0, 0, 350 + 30 * i);
        g_autofree float *lit = take(&usual, &pose, TRUE, (guint32)i);
        write_photograph(test.lit, i, lit);
    }
    g_autofree char *apart = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 0);
    expect_plane(&test, 0.05, 0.1);
    g_unlink(test.output);
    /* Too few, of which one is too faint. */
    struct scene faint = usual;
    faint.laser = 0.005;
    const struct pose pose = pose_of(0.1, 0.3, 1, 0, 0, 400);
    g_autofree float *lit = take(&faint, &pose, TRUE, 9);
    g_autofree char *third = g_build_filename(test.lit, "03.ppm", NULL);
    g_unlink(third);
    write_photograph(test.lit, 0, lit);
    g_autofree char *few = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 1);
    g_assert_nonnull(strstr(few,
                            "2 of 3 photographs show board and laser line, but at least 3 must: "
                            "take more photographs"));
    g_assert_nonnull(strstr(few, "00.ppm: no line on the board is "));
    end(&test);
}

/* The plane of plain least squares: in each row the centroid of the red light that the room does
 * not explain, on its ray, on the true board; x = a·y + b·z + c through these points. */
static void plain_plane(float *const *photographs, const struct pose *poses, int n, double ret[4]) {
    double h[3][4] = {{0}}, x[3];
    for (int row = 0; row < n * HEIGHT; row++) {
        const float *rgb = photographs[row / HEIGHT] + (gsize)3 * (gsize)(row % HEIGHT) * WIDTH;
        const struct pose *pose = &poses[row / HEIGHT];
        const double(*r)[3] = pose->rotation;
        const double *t = pose->shift;
        double sum = 0, mean = 0;
        for (int i = 0; i < WIDTH; i++) {
            const double light = (double)rgb[3 * i] - 1.1 * (double)rgb[3 * i + 1];
            if (light < 0.05)
                continue;
            sum += light;
            mean += light * i;
        }
        if (sum < 0.5)
            continue;
        const double u = (mean / sum - CX) / FOCAL, v = (row % HEIGHT - CY) / FOCAL;
        double a = u, b = v;
        for (int step = 0; step < 20; step++) {
            const double rr = a * a + b * b, bend = 1 + K1 * rr + K2 * rr * rr;
            a = u / bend;
            b = v / bend;
        }
        const double facing = r[0][2] * t[0] + r[1][2] * t[1] + r[2][2] * t[2];
        const double far = facing / (r[0][2] * a + r[1][2] * b + r[2][2]);
        const double d[3] = {far * a - t[0], far * b - t[1], far - t[2]};
        const double at[2] = {r[0][0] * d[0] + r[1][0] * d[1] + r[2][0] * d[2],
                              r[0][1] * d[0] + r[1][1] * d[1] + r[2][1] * d[2]};
        if (fabs(at[0]) > 88 || fabs(at[1]) > 68) /* not on the print */
            continue;
        const double of[4] = {far * b, far, 1, far * a};
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 4; k++)
                h[i][k] += of[i] * of[k];
    }
    for (int i = 0; i < 3; i++) /* Gauss and Jordan; the matrix is positive definite */
        for (int k = 0; k < 3; k++) {
            const double times = h[k][i] / h[i][i];
            for (int l = 0; l < 4 && k != i; l++)
                h[k][l] -= times * h[i][l];
        }
    for (int i = 0; i < 3; i++)
        x[i] = h[i][3] / h[i][i];
    const double length = sqrt(1 + x[0] * x[0] + x[1] * x[1]);
    ret[0] = 1 / length;
    ret[1] = -x[0] / length;
    ret[2] = -x[1] / length;
    ret[3] = x[2] / length;
}

#define PRINTS 8

static int print_table(void) {
    double chi2[2] = {0}, squares[2][2] = {{0}};
    is_printing = TRUE;
    g_print(
        "photographs  plane off by, stated    normal off by, stated     plain: plane  normal\n");
    for (int i = 0; i < PRINTS; i++) {
        const int n = 4 + i % 3;
        struct test test;
        struct pose poses[6];
        float *photographs[6];
        double t[24], plain[4], off_mm, off_rad, plain_mm, plain_rad;
        int code;
        GRand *rand = g_rand_new_with_seed((guint32)(500 + i));
        begin(&test);
        for (int k = 0; k < n; k++) {
            poses[k] = random_pose(rand);
            photographs[k] = take(&usual, &poses[k], TRUE, (guint32)(1000 * i + k));
            write_photograph(test.lit, k, photographs[k]);
        }
        g_rand_free(rand);
        g_free(run(&test, CHARUCO, FALSE, &code));
        g_assert_cmpint(code, ==, 0);
        read_table(&test, t);
        plain_plane(photographs, poses, n, plain);
        deviation(t, t + 20, &off_mm, &off_rad);
        deviation(plain, t + 20, &plain_mm, &plain_rad);
        /* How far the plain plane is from the true one at the same point. */
        plain_mm = fabs(plain[0] * t[20] + plain[1] * t[21] + plain[2] * t[22] - plain[3]);
        const double tilt = sqrt(t[4] + t[9] + t[14]);
        g_print("%11d  %.4f, %.4f mm       %.4f, %.4f°      %.4f mm  %.4f°\n", n, off_mm, t[23],
                off_rad * 180 / G_PI, tilt * 180 / G_PI, plain_mm, plain_rad * 180 / G_PI);
        chi2[0] += pow(off_mm / t[23], 2) / PRINTS;
        chi2[1] += pow(off_rad / tilt, 2) / PRINTS;
        squares[0][0] += off_mm * off_mm / PRINTS;
        squares[0][1] += off_rad * off_rad / PRINTS;
        squares[1][0] += plain_mm * plain_mm / PRINTS;
        squares[1][1] += plain_rad * plain_rad / PRINTS;
        for (int k = 0; k < n; k++)
            g_free(photographs[k]);
        end(&test);
    }
    g_print("RMS: %.4f mm, %.4f°; plain: %.4f mm, %.4f°; (off / stated)²: %.2f, %.2f\n",
            sqrt(squares[0][0]), sqrt(squares[0][1]) * 180 / G_PI, sqrt(squares[1][0]),
            sqrt(squares[1][1]) * 180 / G_PI, chi2[0], chi2[1]);
    return 0;
}

/* A board of another size than the one that is photographed. */
TEST(wrong_board) {
    static const struct {
        const char *real, *given, *says;
        int photographs;
    } boards[] = {
        {CHESS, "8x6,square=20", "the pictures show 8 × 6 inner corners = 9 × 7 squares", 2},
        {CHARUCO, "8x6,square=20,marker=14,dictionary=4x4_50",
         "but they do not lie as on the board of 8 × 6: the picture shows another board", 1}};
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++) {
        struct scene scene = usual;
        struct test test;
        int code;
        scene.board = boards[i].real;
        begin(&test);
        take_all(&test, &scene, boards[i].photographs, TRUE, 62);
        g_autofree char *said = run(&test, boards[i].given, TRUE, &code);
        g_assert_cmpint(code, ==, 1);
        assert_has(said, boards[i].says);
        g_assert_false(g_file_test(test.output, G_FILE_TEST_EXISTS));
        end(&test);
    }
}

/* The side of a square is the only length that is known: a wrong one scales the plane's distance
 * and leaves its normal. */
TEST(wrong_squares) {
    struct test test;
    int code;
    double right[24], wrong[24];
    begin(&test);
    take_all(&test, &usual, 4, FALSE, 70);
    g_free(run(&test, CHARUCO, FALSE, &code));
    g_assert_cmpint(code, ==, 0);
    read_table(&test, right);
    g_unlink(test.output);
    g_unlink(test.plane);
    g_free(run(&test, "9x7,square=25,marker=17.5,dictionary=4x4_50", FALSE, &code));
    g_assert_cmpint(code, ==, 0);
    read_table(&test, wrong);
    for (int k = 0; k < 3; k++)
        g_assert_cmpfloat_with_epsilon(wrong[k], right[k], 2e-4);
    g_assert_cmpfloat_with_epsilon(wrong[3] / right[3], 1.25, 1e-3);
    end(&test);
}

/* In a grey photograph white print is as bright as the line: one without the laser is needed. */
TEST(grey) {
    struct scene scene = usual;
    struct test test;
    int code;
    scene.grey = TRUE;
    begin(&test);
    take_all(&test, &scene, 1, FALSE, 80);
    g_autofree char *one = run(&test, CHARUCO, FALSE, &code);
    g_assert_cmpint(code, ==, 1);
    assert_has(one, "0 of 1 photographs show board and laser line, but at least 3 must: take more");
    assert_has(one, "take the same photographs without the laser, and give --dark-images");
    /* With its pair the line is seen, but one photograph does not determine a plane. */
    take_all(&test, &scene, 1, TRUE, 80);
    g_autofree char *pair = run(&test, CHARUCO, TRUE, &code);
    g_assert_cmpint(code, ==, 1);
    assert_has(pair,
               "1 of 1 photographs show board and laser line, but at least 3 must: take more");
    end(&test);
}

TEST(usage) {
    struct test test;
    int code;
    begin(&test);
    const char *const calls[][12] = {
        {MESORIG, "calibrate", "laser", "--images", test.lit, "-c", test.lens, "-o", test.output},
        {MESORIG, "calibrate", "laser", "--images", test.lit, "-b", CHESS, "-o", test.output},
        {MESORIG, "calibrate", "laser", "--images", test.lit, "-b", "9", "-c", test.lens, "-o",
         test.output},
        {MESORIG, "calibrate", "laser", "x.session", "-b", CHESS, "-o", test.output},
        {MESORIG, "calibrate", "laser", "-o", test.output}};
    static const char *const says[] = {"give --board", "give -c FILE", "board “9”",
                                       "are for --images", "give captured sessions"};
    for (gsize i = 0; i < G_N_ELEMENTS(calls); i++) {
        g_autofree char *out = NULL, *err = NULL;
        code = process_run(calls[i], &out, &err);
        g_test_message("%s", err);
        g_assert_cmpint(code, ==, 2);
        g_assert_nonnull(strstr(err, says[i]));
    }
    end(&test);
}

int main(int argc, char **argv) {
    return argc == 2 && g_str_equal(argv[1], "--print") ? print_table() : tests_run(argc, argv);
}
