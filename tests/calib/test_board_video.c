/* A lens from a video of a board that is moved from place to place: which frames are chosen, and
 * what lens they give. A formula draws the board, and OpenCV writes the video. */
#include "calibration/calibration.h"
#include "cameras/board.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "pictures/video.h"
#include "write_video.h"

#include <math.h>
#include <string.h>

#define MESORIG  BUILD_DIR "/bin/mesorig"
#define BOARD    "10x7,square=25"
#define WIDTH    320
#define HEIGHT   240
#define FOCAL_PX 330
#define SAMPLES  4 /* a pixel, along each side */
#define PLACES   9
#define SHOWN    14 /* frames of each place: four blurred by its motion, and ten sharp */
#define SHARP    10
#define BLUR     7 /* pixels to each side */

static char *folder, *path;

static gboolean is_sharp(int frame) {
    return frame % SHOWN >= SHOWN - SHARP;
}

/* sRGB codes of the board at a place. */
static void draw(const struct board *board, int place, guint8 *ret) {
    struct rig_camera camera = {.width = WIDTH, .height = HEIGHT, .fx_px = FOCAL_PX};
    camera.cx_px = (WIDTH - 1) / 2.0;
    camera.cy_px = (HEIGHT - 1) / 2.0;
    rig_camera_look_at(&camera, vec3_scale(rig_direction(0.25 + 0.05 * place, 2.5 * place), 420),
                       vec3(6.0 * (place % 3 - 1), 5.0 * (place / 3 - 1), 0));
    const struct vec3 from = rig_camera_centre_mm(&camera);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double xy[2 * SAMPLES * SAMPLES], sum = 0;
        float values[SAMPLES * SAMPLES];
        for (int k = 0; k < SAMPLES * SAMPLES; k++) {
            const double x = i % WIDTH + (k % SAMPLES + 0.5) / SAMPLES - 0.5 - camera.cx_px;
            const int row = k / SAMPLES;
            const double y = i / WIDTH + (row + 0.5) / SAMPLES - 0.5 - camera.cy_px;
            const struct vec3 ray =
                mat3_mul_transposed(&camera.rotation, vec3(x / FOCAL_PX, y / FOCAL_PX, 1));
            xy[2 * k] = from.x - from.z / ray.z * ray.x;
            xy[2 * k + 1] = from.y - from.z / ray.z * ray.y;
        }
        board_values(board, xy, SAMPLES * SAMPLES, values);
        for (int k = 0; k < SAMPLES * SAMPLES; k++)
            sum += 0.1 + 0.8 * (values[k] < 0 ? 1 : (double)values[k]);
        const double v = sum / (SAMPLES * SAMPLES);
        ret[i] = (guint8)lround(255 * (1.055 * pow(v, 1 / 2.4) - 0.055));
    }
}

/* Motion to the right: a mean along rows. */
static void blur(const guint8 *from, int reach, guint8 *ret) {
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        int sum = 0;
        for (int k = -reach; k <= reach; k++)
            sum += from[i / WIDTH * WIDTH + CLAMP(i % WIDTH + k, 0, WIDTH - 1)];
        ret[i] = (guint8)(sum / (2 * reach + 1));
    }
}

/* PLACES places, and the second one again at the end. */
static void write_it(void) {
    const gsize n = WIDTH * HEIGHT;
    struct board board;
    g_autofree guint8 *frames = g_new(guint8, n * (PLACES + 1) * SHOWN);
    g_autofree guint8 *still = g_new(guint8, n);
    g_assert_true(board_parse(&board, BOARD, NULL));
    for (int i = 0; i < (PLACES + 1) * SHOWN; i++) {
        guint8 *frame = frames + (gsize)i * n;
        if (i % SHOWN == 0)
            draw(&board, i / SHOWN < PLACES ? i / SHOWN : 1, still);
        if (is_sharp(i))
            memcpy(frame, still, n);
        else
            blur(still, BLUR - i % SHOWN / 2, frame);
    }
    write_video(path, frames, (PLACES + 1) * SHOWN, WIDTH, HEIGHT);
}

/* With half as many windows as places have frames, each keeps a frame of its sharpest. */
TEST(windows) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Video) all = video_read(path, 1000, NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(all->n_frames, ==, (PLACES + 1) * SHOWN);
    g_assert_cmpuint(all->frames->len, ==, all->n_frames);
    g_assert_cmpint(all->width, ==, WIDTH);
    g_assert_cmpint(all->height, ==, HEIGHT);
    g_autoptr(Video) some = video_read(path, 20, NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpint(some->n_frames, ==, all->n_frames);
    g_assert_cmpuint(some->frames->len, ==, 18); /* windows of 8 frames */
    for (guint i = 0; i < some->frames->len; i++) {
        const struct video_frame *kept = &g_array_index(some->frames, struct video_frame, i);
        g_assert_cmpint(kept->index / 8, ==, i);
        for (guint k = 8 * i; k < MIN(8 * i + 8, all->frames->len); k++)
            g_assert_cmpfloat(g_array_index(all->frames, struct video_frame, k).sharpness, <=,
                              kept->sharpness);
        for (int k = 8 * (int)i; k < 8 * (int)i + 8 && k < all->n_frames; k++)
            g_assert_true(is_sharp(kept->index) || !is_sharp(k));
    }
}

TEST(lens) {
    g_autofree char *output = g_build_filename(folder, "lens.calibration", NULL);
    g_autofree char *corners = g_build_filename(folder, "corners", NULL);
    g_autofree char *out = NULL, *err = NULL, *text = NULL;
    g_autoptr(GHashTable) places = g_hash_table_new(NULL, NULL);
    const char *const arguments[] = {MESORIG,   "calibrate", "cameras", "--images",   path,
                                     "--board", BOARD,       "--lens",  "polynomial", "-o",
                                     output,    "--corners", corners,   NULL};
    const int code = process_run(arguments, &out, &err);
    g_test_message("%s%s", out, err);
    g_assert_cmpint(code, ==, 0);
    g_assert_nonnull(strstr(out, "140 frames"));
    g_assert_nonnull(strstr(out, "and 9 with the board at different places were chosen"));
    g_assert_true(g_file_get_contents(corners, &text, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (int i = 2; lines[i] && *lines[i]; i++) { /* after a comment and the columns */
        const char *number = strchr(lines[i], '#');
        g_assert_nonnull(number);
        const int frame = atoi(number + 1), place = frame / SHOWN;
        g_assert_true(is_sharp(frame));
        g_hash_table_add(places, GINT_TO_POINTER(place < PLACES ? place : 1));
    }
    g_assert_cmpuint(g_hash_table_size(places), ==, PLACES);
    g_autoptr(Calibration) calibration = calibration_read(output, NULL);
    g_assert_nonnull(calibration);
    const double fx = calibration->rig.cameras[0].fx_px;
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("focal length %.2f ± %.2f px", fx, sigma);
    g_assert_cmpint(calibration->parts[CALIBRATION_CAMERAS].pictures, ==, PLACES);
    g_assert_cmpfloat(fabs(fx - FOCAL_PX), <, 3 * sigma);
    g_assert_cmpfloat(sigma, <, 0.01 * FOCAL_PX);
}

static void expect_error(const char *images, const char *board, const char *says) {
    g_autofree char *output = g_build_filename(folder, "none.calibration", NULL);
    g_autofree char *out = NULL, *err = NULL;
    const char *const arguments[] = {MESORIG,   "calibrate", "cameras", "--images", images,
                                     "--board", board,       "-o",      output,     NULL};
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 1);
    g_test_message("%s", err);
    g_assert_nonnull(strstr(err, says));
    g_assert_false(g_file_test(output, G_FILE_TEST_EXISTS));
}

TEST(refused) {
    g_autofree char *text = g_build_filename(folder, "video.mp4", NULL);
    g_autofree char *still = g_build_filename(folder, "still.avi", NULL);
    g_autofree guint8 *grey = g_malloc0(6 * WIDTH * HEIGHT);
    g_assert_true(g_file_set_contents(text, "no video", -1, NULL));
    expect_error(text, BOARD, "video.mp4 is not a folder of pictures, and not a video");
    write_video(still, grey, 6, WIDTH, HEIGHT);
    expect_error(still, BOARD, "the board is in none of the 6 sharpest of its 6 frames");
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-board-video-XXXXXX", NULL);
    path = g_build_filename(folder, "board.avi", NULL);
    write_it();
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
    g_free(path);
}
