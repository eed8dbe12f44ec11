/* Camera raw: numbers, levels and filters of DNG files that tests/lib/write_dng.h writes; a lens
 * from real photographs of boards as mosaics; a BTF's pictures of them are in test_foreign_rig. */
#include "calibration/calibration.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/write_dng.h"
#include "pictures/picture_read.h"
#include "pictures/raw.h"
#include "pictures/vision.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define MESORIG BUILD_DIR "/bin/mesorig"
#define WIDTH   64
#define HEIGHT  48
#define WHITE   15000

static char *folder;

/* Every number from below black to white and beyond. */
static void fill(guint16 values[WIDTH * HEIGHT]) {
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        values[i] = (guint16)(400 + i * 5 % 16000);
}

static const struct levels {
    const char *path, *cfa; /* the filter of the active area */
    guint32 black[4];
    int top, left;
    int later;        /* LibRaw begins an area with odd margins a row and a column later, */
    const char *then; /* where the filter is this one */
} levels[] = {
    {"/camera raw/levels/rggb", "rggb", {512, 512, 512, 512}, 0, 0},
    {"/camera raw/levels/bggr", "bggr", {500, 520, 530, 512}, 0, 0},
    {"/camera raw/levels/grbg with margins", "grbg", {500, 520, 530, 512}, 6, 8},
    {"/camera raw/levels/gbrg with odd margins", "gbrg", {512, 512, 512, 512}, 5, 3, 1, "grbg"},
    {"/camera raw/levels/mono", "mono", {512, 512, 512, 512}, 0, 0},
};

static void test_levels(gconstpointer data) {
    const struct levels *l = data;
    g_autofree char *path = g_build_filename(folder, "levels.DNG", NULL);
    g_autoptr(GError) error = NULL;
    guint16 values[WIDTH * HEIGHT];
    char cfa[RAW_CFA];
    struct dng dng = {.width = WIDTH, .height = HEIGHT, .values = values, .cfa = l->cfa};
    fill(values);
    memcpy(dng.black, l->black, sizeof dng.black);
    dng.white = WHITE;
    dng.top = l->top;
    dng.left = l->left;
    write_dng(path, &dng);
    g_autoptr(Picture) picture = raw_read(path, cfa, &error);
    g_assert_no_error(error);
    const int top = l->top + l->later, left = l->left + l->later;
    g_assert_cmpstr(cfa, ==, l->then ? l->then : l->cfa);
    g_assert_cmpint(picture->width, ==, WIDTH - left);
    g_assert_cmpint(picture->height, ==, HEIGHT - top);
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const double n = values[(y + top) * WIDTH + x + left];
            const double black = l->black[2 * (y & 1) + (x & 1)];
            g_assert_cmpfloat_with_epsilon((double)picture->values[y * picture->width + x],
                                           (n - black) / (WHITE - black), 1e-6);
        }
}

static void expect_error(const char *path, const char *says) {
    g_autoptr(GError) error = NULL;
    g_assert_null(picture_read(path, &error));
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, path));
    g_assert_nonnull(strstr(error->message, says));
}

TEST(refused) {
    g_autofree char *path = g_build_filename(folder, "refused.dng", NULL);
    g_autofree char *bytes = NULL;
    guint16 values[WIDTH * HEIGHT];
    gsize length;
    struct dng dng = {.width = WIDTH, .height = HEIGHT, .values = values, .cfa = "rggb"};
    fill(values);
    dng.white = 300;
    for (int i = 0; i < 4; i++)
        dng.black[i] = 512;
    write_dng(path, &dng);
    expect_error(path, "the black level of 512 is not below the white level of 300");
    dng.white = WHITE;
    dng.repeat = 6;
    write_dng(path, &dng);
    expect_error(path, "has no mosaic of 2 × 2 colour filters");
    dng.repeat = 0;
    write_dng(path, &dng);
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_assert_true(g_file_set_contents(path, bytes, 1500, NULL));
    expect_error(path, "is not a camera raw picture that can be read");
    g_assert_true(g_file_set_contents(path, "P5 4 4 255 ................", -1, NULL));
    expect_error(path, "is not a camera raw picture that can be read");
}

/* A file on which LibRaw 0.20 ends with a signal: an error of one picture, not the end of the
 * program. */
TEST(crash) {
    static const char path[] = SOURCE_DIR "/tests/fuzz/corpus/camera_raw/57594b45be5b";
    char cfa[RAW_CFA];
    g_autoptr(GError) error = NULL;
    g_assert_null(raw_read(path, cfa, &error));
    g_assert_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO);
    g_test_message("%s", error->message);
    assert_has(error->message, path);
}

static gboolean is_over;

static gpointer use_memory(gpointer unused) {
    while (!g_atomic_int_get(&is_over))
        g_free(g_malloc((gsize)g_random_int_range(1, 4000)));
    return NULL;
}

/* The reader does not depend on what other threads do at the moment at which it is started. A child
 * that is only forked inherits their locks, and waits for ever for the one of the memory. */
TEST(busy_threads) {
    g_autofree char *path = g_build_filename(folder, "busy.dng", NULL);
    guint16 values[WIDTH * HEIGHT];
    struct dng dng = {
        .width = WIDTH, .height = HEIGHT, .values = values, .cfa = "rggb", .white = WHITE};
    GThread *threads[2];
    fill(values);
    write_dng(path, &dng);
    alarm(300);
    for (gsize i = 0; i < G_N_ELEMENTS(threads); i++)
        threads[i] = g_thread_new("busy", use_memory, NULL);
    for (int i = 0; i < 10; i++) {
        g_autoptr(GError) error = NULL;
        char cfa[RAW_CFA];
        g_autoptr(Picture) picture = raw_read(path, cfa, &error);
        g_assert_no_error(error);
    }
    g_atomic_int_set(&is_over, TRUE);
    for (gsize i = 0; i < G_N_ELEMENTS(threads); i++)
        g_thread_join(threads[i]);
    alarm(0);
}

/* OpenCV's photographs as mosaics of a sensor that sees red and blue weaker, with the levels of a
 * camera: the lens is that of the photographs. */
#define OPENCV_FOCAL_PX 532.8 /* of 13 of them; its standard error is 0.6 px */
static const char *const names[] = {"left01", "left02", "left03", "left04", "left05", "left06"};

static void write_mosaic(const char *name) {
    static const double gain[3] = {0.45, 0.9, 0.6};
    static const char cfa[] = "grbg";
    g_autofree char *from = g_strdup_printf("/usr/share/doc/opencv-doc/examples/data/%s.jpg", name);
    g_autofree char *to = g_strdup_printf("%s/boards/%s.dng", folder, name);
    g_auto(PictureCodes) codes = {0};
    float srgb[256];
    ok(picture_read_codes(from, &codes, ERR));
    const int width = codes.width, height = codes.height;
    picture_srgb(srgb);
    g_autofree guint16 *values = g_new(guint16, width * height);
    for (int k = 0; k < width * height; k++) {
        const int c = (int)(strchr("rgb", cfa[2 * (k / width & 1) + (k % width & 1)]) - "rgb");
        values[k] = (guint16)lround(1024 + gain[c] * (16383 - 1024) *
                                               (double)srgb[(int)codes.rgb[3 * k + c]]);
    }
    write_dng(to, &(struct dng){.width = width,
                                .height = height,
                                .values = values,
                                .cfa = cfa,
                                .black = {1024, 1024, 1024, 1024},
                                .white = 16383});
}

TEST(boards) {
    g_autofree char *boards = g_build_filename(folder, "boards", NULL);
    g_autofree char *output = g_build_filename(folder, "lens.calibration", NULL);
    g_autofree char *out = NULL, *err = NULL;
    g_assert_cmpint(g_mkdir(boards, 0755), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++)
        write_mosaic(names[i]);
    const char *const arguments[] = {MESORIG, "calibrate", "cameras",        "--images",
                                     boards,  "--board",   "10x7,square=25", "-o",
                                     output,  "--lens",    "polynomial",     NULL};
    const int code = process_run(arguments, &out, &err);
    g_test_message("%s%s", out, err);
    g_assert_cmpint(code, ==, 0);
    g_autoptr(Calibration) calibration = calibration_read(output, NULL);
    g_assert_nonnull(calibration);
    const double fx = calibration->rig.cameras[0].fx_px;
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("focal length %.2f ± %.2f px", fx, sigma);
    g_assert_cmpint(calibration->parts[CALIBRATION_CAMERAS].pictures, ==, G_N_ELEMENTS(names));
    g_assert_cmpfloat(fabs(fx - OPENCV_FOCAL_PX), <, 2 * hypot(sigma, 0.6));
    g_assert_cmpfloat(sigma, <, 2.5);
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-camera-raw-XXXXXX", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(levels); i++)
        g_test_add_data_func(levels[i].path, &levels[i], test_levels);
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
}
