/*
 * Lenses from photographs that a real camera took, and mesorig calibrate cameras --images as a
 * shell sees it: the two sets of chessboards that come with OpenCV (Debian's opencv-doc), and what
 * is made of them.
 */
#include "cameras/board_find.h"
#include "cameras/cameras.h"
#include "exr/exr.h"
#include "lib/calibration_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/told_pictures.h"
#include "pictures/picture_read.h"
#include "pictures/vision.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define PHOTOGRAPHS "/usr/share/doc/opencv-doc/examples/data"
#define BOARD       "10x7,square=25"
#define N           13
#define MESORIG     BUILD_DIR "/bin/mesorig"

static const int numbers[N] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14};

static char *path_of(const char *side, int i) {
    char *path = g_strdup_printf(PHOTOGRAPHS "/%s%02d.jpg", side, numbers[i]);
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
        g_error("%s is missing: install the package opencv-doc; where dpkg is told to leave out "
                "documentation, with --path-include='/usr/share/doc/opencv-doc/*'",
                path);
    return path;
}

static struct picture *read_side(int i, gpointer data, GError **error) {
    g_autofree char *path = path_of(data, i);
    return picture_read(path, error);
}

static struct calibration *calibrate(const char *board, int width, int height, int n,
                                     CamerasRead read, gpointer data, double *ret_rms_px,
                                     GError **error) {
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    struct cameras_picture pictures[N];
    struct cameras_task task = {.pictures = pictures, .n_pictures = n, .read = read, .data = data};
    rig.cameras[0] = (struct rig_camera){.name = "camera", .width = width, .height = height};
    rig.cameras[0].response = 1;
    rig.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (int i = 0; i < n; i++)
        pictures[i] = (struct cameras_picture){0, i, 0};
    g_assert_true(board_parse(&task.board, board, NULL));
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    g_autoptr(CamerasResult) result = cameras_calibrate_lens(calibration, &task, error);
    if (!result)
        return NULL;
    const GPtrArray *rejected = calibration->parts[CALIBRATION_CAMERAS].rejected;
    for (guint i = 0; i < rejected->len; i++)
        g_test_message("%s", (char *)rejected->pdata[i]);
    *ret_rms_px = result->rms_px;
    return g_steal_pointer(&calibration);
}

/* Calibrates all pictures of a side, once. */
static const struct calibration *calibrate_side(const char *side, double *ret_rms_px) {
    static struct calibration *calibrations[2];
    static double rms_px[2];
    const int right = g_str_equal(side, "right");
    if (!calibrations[right])
        calibrations[right] =
            ok(calibrate(BOARD, 640, 480, N, read_side, (gpointer)side, &rms_px[right], ERR));
    *ret_rms_px = rms_px[right];
    return calibrations[right];
}

/* OpenCV 4.6 uses all of both as well; its focal lengths' standard error is 0.6 px. */
static const struct set {
    const char *path, *side;
    double opencv_focal_px, opencv_rms_px;
} sets[] = {{"/photographed boards/left", "left", 532.8, 0.195},
            {"/photographed boards/right", "right", 537.5, 0.207}};

static void test_set(gconstpointer data) {
    const struct set *set = data;
    double rms_px;
    const struct calibration *calibration = calibrate_side(set->side, &rms_px);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    const double fx = calibration->rig.cameras[0].fx_px;
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("%s: %d pictures, %d corners, %.3f px RMS, focal length %.2f ± %.2f px",
                   set->side, part->pictures, calibration->cameras[0].points, rms_px, fx, sigma);
    g_assert_cmpint(part->pictures, ==, N);
    g_assert_cmpint(calibration->cameras[0].points, >=, N * 54 * 98 / 100);
    g_assert_cmpfloat(rms_px, <, set->opencv_rms_px);
    g_assert_cmpfloat(fabs(fx - set->opencv_focal_px), <, 2 * hypot(sigma, 0.6));
    g_assert_cmpint(calibration->rig.cameras[0].lens, ==, RIG_LENS_POLYNOMIAL);
    /* With the scatter between photographs (0.4 without), and the bend of the board, from which the
     * focal length is hardly told apart in the right ones. */
    g_assert_cmpfloat(sigma, <, 1.3);
}

/* As with another zoom; around a smaller picture, its outermost pixels. */
static void zoom(struct picture *picture, double scale) {
    g_autofree float *from =
        g_memdup2(picture->values, sizeof(float) * (gsize)picture->width * (gsize)picture->height);
    const double cx = (picture->width - 1) / 2.0, cy = (picture->height - 1) / 2.0;
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const double u = CLAMP(cx + (x - cx) / scale, 0, picture->width - 1);
            const double v = CLAMP(cy + (y - cy) / scale, 0, picture->height - 1);
            const int i = (int)u, j = (int)v;
            const float *at = from + j * picture->width + i;
            const int right = i + 1 < picture->width ? 1 : 0;
            const int down = j + 1 < picture->height ? picture->width : 0;
            const double top = at[0] + (u - i) * (at[right] - at[0]);
            const double bottom = at[down] + (u - i) * (at[down + right] - at[down]);
            picture->values[y * picture->width + x] = (float)(top + (v - j) * (bottom - top));
        }
}

/* Pictures 2, 5 and 8 in another way each. */
static struct picture *read_zoomed(int i, gpointer data, GError **error) {
    struct picture *picture = read_side(i, data, error);
    if (picture && i % 3 == 2 && i < 9)
        zoom(picture, 0.8 - 0.04 * i);
    return picture;
}

TEST(other_zoom) {
    g_autoptr(GError) error = NULL;
    double rms_px;
    g_autoptr(Calibration) calibration =
        calibrate(BOARD, 640, 480, N, read_zoomed, (gpointer) "left", &rms_px, &error);
    g_assert_no_error(error);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    g_test_message("%.3f px RMS, focal length %.2f px", rms_px, calibration->rig.cameras[0].fx_px);
    g_assert_cmpint(part->pictures, ==, N - 3);
    g_assert_cmpfloat(rms_px, <, 0.195);
}

/* A lens of known focal length before a chessboard at eight tilts: formulas, with almost no noise,
 * but ripples of a fifth of a pixel that each picture has anew. Corners look far better than they
 * are, as after compression. */
#define WIDTH     320
#define HEIGHT    240
#define FOCAL_PX  330
#define SAMPLES   4 /* a pixel, along each side */
#define N_DRAWN   8
#define RIPPLE_PX 0.2

static double sample(const struct board *board, const struct rig_camera *camera, double x,
                     double y) {
    const struct vec3 ray = mat3_mul_transposed(
        &camera->rotation, vec3((x - camera->cx_px) / FOCAL_PX, (y - camera->cy_px) / FOCAL_PX, 1));
    const struct vec3 from = rig_camera_centre_mm(camera);
    const double t = -from.z / ray.z;
    float value;
    board_values(board, (const double[]){from.x + t * ray.x, from.y + t * ray.y}, 1, &value);
    return value < 0 ? 1 : (double)value;
}

static struct picture *draw(int i, const struct board *board) {
    struct rig_camera camera = {.width = WIDTH, .height = HEIGHT, .fx_px = FOCAL_PX};
    struct picture *picture = picture_new("drawn", "drawn", WIDTH, HEIGHT);
    GRand *rand = g_rand_new_with_seed((guint32)i);
    const double phase = g_rand_double_range(rand, 0, 2 * G_PI);
    camera.cx_px = (WIDTH - 1) / 2.0;
    camera.cy_px = (HEIGHT - 1) / 2.0;
    rig_camera_look_at(&camera, vec3_scale(rig_direction(0.3 + 0.05 * i, 2.5 * i), 420),
                       vec3(0, 0, 0));
    /* By quarters of a turn. */
    for (; i > 0; i--)
        for (int k = 0; k < 3; k++) {
            const double right = camera.rotation.m[0][k];
            camera.rotation.m[0][k] = camera.rotation.m[1][k];
            camera.rotation.m[1][k] = -right;
        }
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double dx = RIPPLE_PX * sin((x + 2 * y) / 7.0 + phase);
            const double dy = RIPPLE_PX * cos((2 * x - y) / 7.0 + phase);
            double sum = 0;
            for (int k = 0; k < SAMPLES * SAMPLES; k++)
                sum += sample(board, &camera, x + dx + (k % SAMPLES + 0.5) / SAMPLES - 0.5,
                              y + dy + (k / SAMPLES + 0.5) / SAMPLES - 0.5);
            picture->values[y * WIDTH + x] = (float)(0.1 + 0.8 * sum / (SAMPLES * SAMPLES) +
                                                     g_rand_double_range(rand, 0, 0.002));
        }
    g_rand_free(rand);
    return picture;
}

/* The pictures of BOARD, drawn once. */
static struct picture **usual_pictures(void) {
    static struct picture *pictures[N_DRAWN];
    struct board board;
    ok(board_parse(&board, BOARD, ERR));
    for (int i = 0; i < N_DRAWN && !pictures[i]; i++)
        pictures[i] = draw(i, &board);
    return pictures;
}

static struct picture *read_drawn(int i, gpointer data, GError **error) {
    struct picture *const *pictures = data;
    return boards_copy(pictures[i]);
}

TEST(understated) {
    g_autoptr(GError) error = NULL;
    double rms_px;
    g_autoptr(Calibration) calibration =
        calibrate(BOARD, WIDTH, HEIGHT, N_DRAWN, read_drawn, usual_pictures(), &rms_px, &error);
    g_assert_no_error(error);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    const double fx = calibration->rig.cameras[0].fx_px;
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("%d pictures, %.3f px RMS, focal length %.2f ± %.2f px", part->pictures, rms_px,
                   fx, sigma);
    g_assert_cmpint(part->pictures, ==, N_DRAWN);
    g_assert_cmpfloat(rms_px, <, 1.2 * RIPPLE_PX);
    g_assert_cmpfloat(fabs(fx - FOCAL_PX), <, 3 * sigma);
    g_assert_cmpfloat(sigma, <, 0.01 * FOCAL_PX);
}

#define N_EXIF 5
/* Writes drawn photographs with EXIF data, and calibrates them. mm are their focal lengths, in
 * turn, at 10 pixels per mm. */
static char *calibrate_exif(const guint32 mm[2]) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *output = g_build_filename(folder, "lens.calibration", NULL);
    g_autofree guint16 *values = g_new(guint16, WIDTH * HEIGHT);
    char *out = NULL;
    for (int i = 0; i < N_EXIF; i++) {
        const struct picture *picture = usual_pictures()[i];
        g_autofree char *path = g_strdup_printf("%s/%d.png", folder, i);
        const struct told told = {.focal = {mm[i % 2], 1}, .plane = {100, 1}, .plane_unit = 3};
        for (int k = 0; k < WIDTH * HEIGHT; k++)
            values[k] = (guint16)lrintf(255 * picture->values[k]);
        told_png(path, WIDTH, HEIGHT, 1, 8, values, &told);
    }
    const char *const arguments[] = {MESORIG,   "calibrate", "cameras", "--images", folder,
                                     "--board", BOARD,       "-o",      output,     NULL};
    g_assert_cmpint(process_run(arguments, &out, NULL), ==, 0);
    return out;
}

/* The focal length is 330 px. */
TEST(exif) {
    g_autofree char *near = calibrate_exif((const guint32[]){31, 31});
    assert_has(near, "px; the photographs say 310.0 px (EXIF: 31 mm, 10 pixels per mm)");
    g_assert_null(strstr(near, "warning"));
    g_autofree char *cropped = calibrate_exif((const guint32[]){50, 50});
    assert_has(cropped, "% smaller than the EXIF data of the photographs say, 500 px; causes: "
                        "photographs that were cropped");
    g_autofree char *zoomed = calibrate_exif((const guint32[]){33, 35});
    assert_has(zoomed, "the EXIF data of the photographs give focal lengths from 330 to 350 px, so "
                       "the zoom was changed between them");
}

static int by_size(gconstpointer a, gconstpointer b) {
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Returns the median of the relative errors of the initial focal length in 20 trials: three views
 * of a board, tilted by about tilt_deg, with errors of 0.3 px of 6000. */
static double start_error(double tilt_deg, double guess) {
    enum { VIEWS = 3, POINTS = 63, TRIALS = 20 };
    const double focal_px = 6000;
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    g_autoptr(GArray) errors = g_array_new(FALSE, FALSE, sizeof(double));
    for (int trial = 0; trial < TRIALS; trial++) {
        double points[VIEWS][4 * POINTS], focal[2];
        const double *views[VIEWS];
        int n[VIEWS];
        for (int v = 0; v < VIEWS; v++) {
            struct rig_camera camera = {.fx_px = focal_px,
                                        .fy_px = focal_px,
                                        .cx_px = 2999.5,
                                        .cy_px = 1999.5,
                                        .width = 6000,
                                        .height = 4000};
            const double tilt = g_rand_double_range(random, 0, 1.5) * tilt_deg * G_PI / 180;
            const double roll = g_rand_double_range(random, -1, 1);
            rig_camera_look_at(&camera, vec3_scale(rig_direction(tilt, roll), 1), vec3(0, 0, 0));
            camera.translation_mm =
                vec3(g_rand_double_range(random, -100, -40), g_rand_double_range(random, -90, -30),
                     g_rand_double_range(random, 500, 700));
            views[v] = points[v];
            n[v] = POINTS;
            for (int i = 0; i < POINTS; i++) {
                double *p = points[v] + 4 * i;
                p[0] = 20 * (i % 9);
                p[1] = 20 * (int)(i / 9);
                g_assert_true(rig_project(&camera, vec3(p[0], p[1], 0), &p[2], &p[3]));
                for (int k = 2; k < 4; k++)
                    p[k] += 0.52 * (g_rand_double_range(random, -1, 1));
            }
        }
        g_assert_true(
            vision_start_camera(views, n, VIEWS, guess * focal_px, 6000, 4000, focal, NULL));
        const double off = fabs(focal[0] / focal_px - 1);
        g_array_append_val(errors, off);
    }
    g_array_sort(errors, by_size);
    return g_array_index(errors, double, errors->len / 2);
}

/* A guess helps where the views hardly determine the focal length, and does no harm elsewhere, even
 * if it is wrong. */
TEST(guess) {
    const double none = start_error(1, 0), near = start_error(1, 0.95);
    g_test_message("tilts of 1°: median error %.3f without a guess, %.3f with one that is 5 %% off",
                   none, near);
    g_assert_cmpfloat(near, <, 0.3 * none);
    const double tilted = start_error(15, 0), wrong = start_error(15, 1.5);
    g_test_message(
        "tilts of 15°: median error %.5f without a guess, %.5f with one that is 50 %% off", tilted,
        wrong);
    g_assert_cmpfloat(fabs(wrong - tilted), <, 1e-4);
}

/* Chessboards that look the same upside down, with a black and with a white first square, seen by
 * the same lens. */
static const struct alike {
    const char *path, *board;
    gboolean white_first;
} alikes[] = {{"/photographed boards/even", "8x6,square=25", FALSE},
              {"/photographed boards/even, white first", "8x6,square=25", TRUE},
              {"/photographed boards/odd", "9x7,square=25", FALSE},
              {"/photographed boards/odd, white first", "9x7,square=25", TRUE}};

static void test_alike(gconstpointer data) {
    const struct alike *alike = data;
    struct board board;
    g_autoptr(GError) error = NULL;
    double rms_px;
    g_assert_true(board_parse(&board, alike->board, NULL));
    board.white_first = alike->white_first;
    struct picture *pictures[N_DRAWN];
    for (int i = 0; i < N_DRAWN; i++)
        pictures[i] = draw(i, &board);
    g_autoptr(Calibration) calibration =
        calibrate(alike->board, WIDTH, HEIGHT, N_DRAWN, read_drawn, pictures, &rms_px, &error);
    g_assert_no_error(error);
    for (int i = 0; i < N_DRAWN; i++)
        picture_free(pictures[i]);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    const double fx = calibration->rig.cameras[0].fx_px;
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("%d pictures, %d corners, %.3f px RMS, focal length %.2f ± %.2f px",
                   part->pictures, calibration->cameras[0].points, rms_px, fx, sigma);
    g_assert_cmpint(part->pictures, ==, N_DRAWN);
    g_assert_cmpint(calibration->cameras[0].points, >=, N_DRAWN * board_n_corners(&board) * 9 / 10);
    g_assert_cmpfloat(rms_px, <, 1.2 * RIPPLE_PX);
    g_assert_cmpfloat(fabs(fx - FOCAL_PX), <, 3 * sigma);
    g_assert_cmpfloat(sigma, <, 0.01 * FOCAL_PX);
}

/* A wide lens that bends the board: by the division model, a point at radius r of the picture (in
 * focal lengths) is seen at r / (1 + BEND r²) (Fitzgibbon 2001), which the calibration's polynomial
 * is not. The board fills the picture. */
#define BEND       -0.55
#define WIDE_PX    150
#define WIDE_BOARD "9x7,square=25"

static struct picture *draw_bent(const struct board *board, struct rig_camera *camera) {
    struct picture *picture = picture_new("bent", "bent", WIDTH, HEIGHT);
    *camera = (struct rig_camera){.width = WIDTH, .height = HEIGHT, .fx_px = FOCAL_PX};
    camera->cx_px = (WIDTH - 1) / 2.0;
    camera->cy_px = (HEIGHT - 1) / 2.0;
    rig_camera_look_at(camera, vec3_scale(rig_direction(0.25, 1), 108), vec3(0, 0, 0));
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            double sum = 0;
            for (int k = 0; k < SAMPLES * SAMPLES; k++) {
                const double u =
                    (x + (k % SAMPLES + 0.5) / SAMPLES - 0.5 - camera->cx_px) / WIDE_PX;
                const int row = k / SAMPLES;
                const double v = (y + (row + 0.5) / SAMPLES - 0.5 - camera->cy_px) / WIDE_PX;
                const double scale = FOCAL_PX / (1 + BEND * (u * u + v * v));
                sum += sample(board, camera, camera->cx_px + scale * u, camera->cy_px + scale * v);
            }
            picture->values[y * WIDTH + x] = (float)(0.1 + 0.8 * sum / (SAMPLES * SAMPLES));
        }
    return picture;
}

TEST(bent) {
    struct board board;
    struct rig_camera camera;
    g_autoptr(GError) error = NULL;
    g_assert_true(board_parse(&board, WIDE_BOARD, NULL));
    g_autoptr(Picture) picture = draw_bent(&board, &camera);
    g_autoptr(GArray) corners = board_find(picture, &board, TRUE, &error);
    g_assert_no_error(error);
    const int n = board_n_corners(&board);
    double sum[2] = {0, 0}; /* of squares, by either order of the corners */
    for (guint i = 0; i < corners->len; i++) {
        const struct corner *corner = &g_array_index(corners, struct corner, i);
        for (int turned = 0; turned < 2; turned++) {
            double mm[2];
            board_corner_mm(&board, turned ? n - 1 - corner->id : corner->id, mm);
            const struct vec3 p = vec3_add(mat3_mul_vec(&camera.rotation, vec3(mm[0], mm[1], 0)),
                                           camera.translation_mm);
            const double straight = hypot(p.x, p.y) / p.z;
            const double seen =
                (1 - sqrt(1 - 4 * BEND * straight * straight)) / (2 * BEND * straight);
            const double x = camera.cx_px + WIDE_PX * seen / straight * p.x / p.z;
            const double y = camera.cy_px + WIDE_PX * seen / straight * p.y / p.z;
            sum[turned] += pow(x - corner->x_px, 2) + pow(y - corner->y_px, 2);
        }
    }
    const double rms_px = sqrt(MIN(sum[0], sum[1]) / corners->len);
    g_test_message("%u of %d corners, %.3f px RMS from where they are", corners->len, n, rms_px);
    g_assert_cmpint((int)corners->len, ==, n);
    g_assert_cmpfloat(rms_px, <, 0.1);
}

/* mesorig calibrate cameras of a folder of these pictures of OpenCV's, and of two hidden files;
 * what it says. */
static char *run(const char *board, const char *const *names, int *ret_code,
                 gboolean *ret_written) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-photographs-XXXXXX", NULL);
    g_autofree char *store = g_build_filename(folder, ".DS_Store", NULL);
    g_autofree char *fork = g_build_filename(folder, "._left01.jpg", NULL);
    g_autofree char *output = g_build_filename(folder, "lens.calibration", NULL);
    g_autoptr(GError) error = NULL;
    char *out = NULL;
    g_autofree char *err = NULL;
    for (int i = 0; names[i]; i++) {
        g_autofree char *from = g_build_filename(PHOTOGRAPHS, names[i], NULL);
        g_autofree char *to = g_build_filename(folder, names[i], NULL);
        g_assert_cmpint(symlink(from, to), ==, 0);
    }
    const char *const arguments[] = {MESORIG,   "calibrate", "cameras", "--images", folder,
                                     "--board", board,       "-o",      output,     NULL};
    g_assert_true(g_file_set_contents(store, "Bud1", -1, NULL));
    g_assert_true(g_file_set_contents(fork, "Mac OS X", -1, NULL));
    *ret_code = process_run(arguments, &out, &err);
    *ret_written = g_unlink(output) == 0;
    for (int i = 0; names[i]; i++) {
        g_autofree char *to = g_build_filename(folder, names[i], NULL);
        g_unlink(to);
    }
    g_unlink(store);
    g_unlink(fork);
    g_rmdir(folder);
    char *both = g_strconcat(out, err, NULL);
    g_test_message("%s", both);
    g_free(out);
    return both;
}

TEST(six) {
    static const char *const names[] = {"left01.jpg", "left02.jpg", "left03.jpg", "left04.jpg",
                                        "left05.jpg", "left06.jpg", NULL};
    gboolean written;
    int code;
    g_autofree char *said = run(BOARD, names, &code, &written);
    g_assert_cmpint(code, ==, 0);
    g_assert_true(written);
    g_assert_nonnull(strstr(said, ": 6 pictures, "));
    g_assert_nonnull(strstr(said, "; 2 left out"));
    g_assert_nonnull(strstr(said, "/._left01.jpg: it is a hidden file"));
    g_assert_nonnull(strstr(said, "/.DS_Store: it is a hidden file"));
}

/* The first by name has another size, and so has the last. */
TEST(other_sizes) {
    static const char *const names[] = {"aloeL.jpg",  "left01.jpg", "left02.jpg",
                                        "left03.jpg", "baboon.jpg", NULL};
    gboolean written;
    int code;
    g_autofree char *said = run(BOARD, names, &code, &written);
    g_assert_cmpint(code, ==, 0);
    g_assert_true(written);
    g_assert_nonnull(strstr(said, ": 3 pictures, "));
    g_assert_nonnull(strstr(said,
                            "aloeL.jpg: the photograph has 1282 × 1110 pixels, but 3 of the 5 "
                            "photographs have 640 × 480"));
    g_assert_nonnull(strstr(said, "baboon.jpg: the photograph has 512 × 512"));
}

/* What OpenCV's programs ask for. The boards have no margin and outer squares that are cut. */
TEST(inner_corners) {
    static const char *const names[] = {"aero1.jpg", "left01.jpg", "left02.jpg", "left03.jpg",
                                        NULL};
    gboolean written;
    int code;
    g_autofree char *said = run("9x6,square=25", names, &code, &written);
    g_assert_cmpint(code, ==, 1);
    g_assert_false(written);
    g_assert_nonnull(strstr(said, "the pictures show 9 × 6 inner corners = 10 × 7 squares ("));
    g_assert_nonnull(strstr(said, "; give --board 10x7,square=25"));
}

/* Four of seven show no board. */
TEST(minority) {
    static const char *const names[] = {"left01.jpg", "left02.jpg", "left03.jpg", "aero1.jpg",
                                        "aero3.jpg",  "stuff.jpg",  "board.jpg",  NULL};
    gboolean written;
    int code;
    g_autofree char *said = run(BOARD, names, &code, &written);
    g_assert_cmpint(code, !=, 0);
    g_assert_false(written);
    g_assert_nonnull(strstr(said, "only 3 of 7 photographs agree on one lens"));
    g_assert_nonnull(strstr(said, "aero1.jpg: no chessboard of 10 × 7 squares"));
}

/* The numbers of a photograph in other formats: an 8-bit bitmap with a palette of greys, bottom row
 * first; a portable graymap with a comment; an uncompressed TIFF; an EXR of linear values. */
static void write_bytes(const char *folder, const char *name, const GByteArray *bytes) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_assert_true(g_file_set_contents(path, (const char *)bytes->data, (gssize)bytes->len, NULL));
}

static void append_numbers(GByteArray *to, int size, int n, const guint32 *values) {
    for (int i = 0; i < n; i++) {
        const guint32 value = GUINT32_TO_LE(values[i]);
        g_byte_array_append(to, (const guint8 *)&value, (guint)size);
    }
}

static void write_as(const char *folder, int i, const guint8 *grey, guint32 width, guint32 height) {
    const guint32 n = width * height;
    g_autofree char *name =
        g_strdup_printf("%02d.%s", i, (const char *const[]){"bmp", "pgm", "TIF", "exr"}[i % 4]);
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    if (i % 4 == 0) {
        const guint32 headers[] = {0x4d42 << 16, 1078 + n, 0, 1078, 40,   width, height,
                                   1 | 8 << 16,  0,        n, 2835, 2835, 256,   0};
        append_numbers(bytes, 4, G_N_ELEMENTS(headers), headers);
        g_byte_array_remove_range(bytes, 0, 2);
        for (guint32 k = 0; k < 256; k++)
            append_numbers(bytes, 4, 1, (const guint32[]){k * 0x010101});
        for (guint32 y = height; y-- > 0;)
            g_byte_array_append(bytes, grey + y * width, width);
    } else if (i % 4 == 1) {
        g_autofree char *head = g_strdup_printf("P5 # 9 9\n%u\n%u 255\n", width, height);
        g_byte_array_append(bytes, (const guint8 *)head, (guint)strlen(head));
        g_byte_array_append(bytes, grey, n);
    } else if (i % 4 == 2) {
        /* width, height, bits, no compression, black is 0, strip's offset, rows and bytes of it */
        const guint32 tags[][2] = {{256, width}, {257, height}, {258, 8},      {259, 1},
                                   {262, 1},     {273, 110},    {278, height}, {279, n}};
        append_numbers(bytes, 4, 2, (const guint32[]){0x002a4949, 8});
        append_numbers(bytes, 2, 1, (const guint32[]){G_N_ELEMENTS(tags)});
        for (gsize k = 0; k < G_N_ELEMENTS(tags); k++)
            append_numbers(bytes, 4, 3, (const guint32[]){tags[k][0] | 4 << 16, 1, tags[k][1]});
        append_numbers(bytes, 4, 1, (const guint32[]){0});
        g_assert_cmpuint(bytes->len, ==, 110);
        g_byte_array_append(bytes, grey, n);
    } else {
        static const char *const channels[] = {"Y", NULL};
        g_autofree char *path = g_build_filename(folder, name, NULL);
        g_autoptr(ExrFile) file = exr_file_new();
        struct exr_part *part =
            exr_part_new("radiance", (int)width, (int)height, channels, EXR_FLOAT);
        for (guint32 k = 0; k < n; k++) {
            const double v = grey[k] / 255.0;
            part->planes[0][k] = (float)(v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4));
        }
        exr_file_add(file, part);
        g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, NULL));
        return;
    }
    write_bytes(folder, name, bytes);
}

TEST(formats) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *output = g_build_filename(folder, "lens.calibration", NULL);
    g_autofree char *corners = g_build_filename(folder, "corners.vnl", NULL);
    g_autofree char *text = NULL, *out = NULL, *err = NULL;
    g_autoptr(GError) error = NULL;
    double rms_px;
    for (int i = 0; i < N; i++) {
        g_autofree char *path = path_of("left", i);
        g_auto(PictureCodes) codes = {0};
        g_assert_true(picture_read_codes(path, &codes, &error));
        const int n = codes.width * codes.height;
        g_autofree guint8 *grey = g_new(guint8, n);
        for (int k = 0; k < n; k++)
            grey[k] = (guint8)codes.rgb[3 * k];
        write_as(folder, i, grey, (guint32)codes.width, (guint32)codes.height);
    }
    const char *const arguments[] = {MESORIG, "calibrate", "cameras", "--images",
                                     folder,  "--board",   BOARD,     "-o",
                                     output,  "--corners", corners,   NULL};
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 0);
    g_test_message("%s%s", out, err);
    const struct calibration *same = calibrate_side("left", &rms_px);
    g_autofree char *said =
        g_strdup_printf(": 13 pictures, %d corners, %.3f px RMS", same->cameras[0].points, rms_px);
    g_assert_nonnull(strstr(out, said));

    /* The corners, of each file all, near where OpenCV's finder sees them, in either order. */
    g_assert_true(g_file_get_contents(corners, &text, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    g_assert_true(g_str_has_prefix(lines[0], "## ")); /* a comment of vnlog */
    g_assert_cmpstr(lines[1], ==, "# filename x y level");
    g_assert_cmpuint(g_strv_length(lines), ==, N * 54 + 3);
    int used = 0;
    for (int i = 0; i < N; i++) {
        double xy[2 * 54], sum[2] = {0, 0};
        g_autoptr(Picture) picture = read_side(i, (gpointer) "left", NULL);
        g_assert_true(vision_find_chessboard(picture, 10, 7, xy, NULL));
        for (int k = 0; k < 54; k++) {
            g_auto(GStrv) words = g_strsplit(lines[2 + i * 54 + k], " ", -1);
            g_assert_cmpuint(g_strv_length(words), ==, 4);
            if (strcmp(words[3], "0") != 0)
                continue;
            const double x = g_ascii_strtod(words[1], NULL), y = g_ascii_strtod(words[2], NULL);
            used++;
            for (int turned = 0; turned < 2; turned++) {
                const double *at = xy + 2 * (turned ? 53 - k : k);
                sum[turned] = MAX(sum[turned], hypot(x - at[0], y - at[1]));
            }
        }
        g_assert_cmpfloat(MIN(sum[0], sum[1]), <, 1.5);
    }
    g_assert_cmpint(used, ==, same->cameras[0].points);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(sets); i++)
        g_test_add_data_func(sets[i].path, &sets[i], test_set);
    for (gsize i = 0; i < G_N_ELEMENTS(alikes); i++)
        g_test_add_data_func(alikes[i].path, &alikes[i], test_alike);
}
