/* Measurements of other laboratories are imported into sessions, and sessions are exported. */
#include "base/data_error.h"
#include "codecs/eigenmaps/eigenmaps.h"
#include "codecs/lpca/lpca.h"
#include "formats/bonn/bonn.h"
#include "formats/export.h"
#include "formats/import.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "scene/picture.h"

#include <glib/gstdio.h>
#include <png.h>
#include <stdlib.h>
#include <sys/wait.h>

#include "lib/assert_error.h"
#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/write_dng.h"

#define WIDTH  6
#define HEIGHT 4
#define TEXELS (WIDTH * HEIGHT)

static const struct work quietly = {0};
static const struct import_wish plainly = {0};

static char *in_folder(const char *name) {
    return g_build_filename(session_fixture_folder, name, NULL);
}

/* What a picture holds; a half holds it too. */
static float value(int view, int light, int texel, int colour) {
    return (float)((view * 37 + light * 11 + texel * 5 + colour * 3) % 97) / 64;
}

static void write_exr(const char *path, int view, int light, int width, int n_nan) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part = exr_part_new("rgb", width, HEIGHT, channels, EXR_HALF);
    for (int i = 0; i < width * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            part->planes[2 - c][i] = i < n_nan ? NAN : value(view, light, i, c);
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, NULL));
}

/* Two views and three lights, keys in both orders. */
static void write_set(const char *dir) {
    static const char *const names[2][3] = {
        {"00001 tl000 pl000 tv015.5 pv000.exr", "00002 tl030 pl090 tv015.5 pv000.exr",
         "00003 tl030.25 pl270.5 tv015.5 pv000.exr"},
        {"tv060.0_pv180.0_tl000.0_pl000.0.exr", "tv060.0_pv180.0_tl030.0_pl090.0.exr",
         "tv060.0_pv180.0_tl030.25_pl270.5.exr"}};
    for (int v = 0; v < 2; v++)
        for (int l = 0; l < 3; l++) {
            g_autofree char *path = g_build_filename(dir, names[v][l], NULL);
            write_exr(path, v, l, WIDTH, 0);
        }
}

static struct btf_matrix *read_back(const char *path) {
    struct btf_matrix *btf = ok(btf_matrix_read(path, NULL, ERR));
    return btf;
}

static void assert_set(const struct btf_matrix *btf) {
    g_assert_cmpint(btf->layout.views.n, ==, 2);
    g_assert_cmpint(btf->layout.lights.n, ==, 3);
    g_assert_cmpint(btf->layout.width, ==, WIDTH);
    g_assert_cmpfloat((double)btf->layout.views.theta_deg[0], ==, 15.5);
    g_assert_cmpfloat((double)btf->layout.views.phi_deg[1], ==, 180);
    g_assert_cmpfloat((double)btf->layout.lights.theta_deg[2], ==, 30.25);
    g_assert_cmpfloat((double)btf->layout.lights.phi_deg[2], ==, 270.5);
    for (int t = 0; t < TEXELS; t++)
        for (int v = 0; v < 2; v++)
            for (int l = 0; l < 3; l++)
                for (int c = 0; c < 3; c++)
                    g_assert_cmpfloat((double)btf->values[((t * 2 + v) * 3 + l) * 3 + c], ==,
                                      (double)value(v, l, t, c));
}

TEST(pictures) {
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("pictures");
    struct import_result result;
    const struct import_wish wish = {.texel_mm = 0.25};
    write_set(dir);
    g_assert_true(ok(import_pictures(path, dir, &wish, &quietly, &result, ERR)));
    struct btf_matrix *btf = read_back(path);
    assert_set(btf);
    g_assert_cmpfloat(btf->layout.texel_mm, ==, 0.25);
    btf_matrix_free(btf);
    g_autofree char *maps_path = g_build_filename(path, "products", "eigenmaps.exr", NULL);
    struct eigenmaps *maps = ok(eigenmaps_read(maps_path, ERR));
    g_assert_cmpint(maps->n_terms, ==, 2);
    g_assert_cmpfloat(result.eigenmaps_error, <, 1e-3);
    eigenmaps_free(maps);
}

static void assert_not_imported(const char *path, GError *error, const char *what) {
    g_autofree char *parent = g_path_get_dirname(path), *base = g_path_get_basename(path);
    g_autofree char *hidden = g_strconcat(".", base, NULL);
    g_autoptr(GDir) dir = g_dir_open(parent, 0, NULL);
    g_assert_nonnull(error);
    assert_has(error->message, what);
    for (const char *name; (name = g_dir_read_name(dir));)
        g_assert_false(g_str_has_prefix(name, hidden) || g_str_equal(name, base));
}

static void assert_folder_refused(const char *dir, const char *what) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = session_fixture_path("refused");
    struct import_result result;
    g_assert_false(import_pictures(path, dir, &plainly, &quietly, &result, &error));
    assert_not_imported(path, error, what);
}

TEST(pictures__bad) {
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree char *one = g_build_filename(dir, "tv060.0_pv180.0_tl030.0_pl090.0.exr", NULL);
    g_autofree char *same = g_build_filename(dir, "again pl90 tl30 pv180 tv60.exr", NULL);
    g_autofree char *odd = g_build_filename(dir, "tv060_pv180_tl030.exr", NULL);
    assert_folder_refused(dir, "the folder has no picture (JPEG");
    assert_folder_refused("/nonexistent", "No such file");
    write_set(dir);
    g_unlink(one);
    assert_folder_refused(
        dir, "1 pairs of a view and a light have no picture, although each of 2 views needs each "
             "of 3 lights. The first pair without a picture is the view from "
             "θ 60° φ 180° under the light from θ 30° φ 90°");
    write_exr(one, 1, 1, WIDTH + 1, 0);
    assert_folder_refused(
        dir, "tl030.0_pl090.0.exr: it has 7 × 4 pixels, but the first picture has 6 × 4");
    write_exr(one, 1, 1, WIDTH, TEXELS / 2 + 1);
    assert_folder_refused(dir, "tl030.0_pl090.0.exr: 13 of its 24 pixels are not numbers");
    write_exr(one, 1, 1, WIDTH, 0);
    write_exr(same, 1, 1, WIDTH, 0);
    assert_folder_refused(dir, "has the same view and light as");
    g_unlink(same);
    write_exr(odd, 1, 1, WIDTH, 0);
    assert_folder_refused(dir, "the name “tv060_pv180_tl030.exr” does not contain its directions");
    g_unlink(odd);
    g_assert_true(g_file_set_contents(one, "not a picture", -1, NULL));
    assert_folder_refused(dir, "tl030.0_pl090.0.exr");
}

TEST(pictures__holes) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("holes");
    g_autofree char *one = g_build_filename(dir, "tv060.0_pv180.0_tl030.0_pl090.0.exr", NULL);
    struct import_result result;
    write_set(dir);
    write_exr(one, 1, 1, WIDTH, 5);
    g_assert_true(import_pictures(path, dir, &plainly, &quietly, &result, &error));
    g_assert_cmpint(result.holes, ==, 5);
    struct btf_matrix *btf = read_back(path);
    g_assert_cmpint(btf->holes, ==, 5);
    /* Filled from the four around it that are none. */
    g_assert_cmpfloat_with_epsilon(
        (double)btf->values[((4 * 2 + 1) * 3 + 1) * 3],
        (double)(value(1, 1, 5, 0) + value(1, 1, 9, 0) + value(1, 1, 10, 0) + value(1, 1, 11, 0)) /
            4,
        1e-3);
    g_assert_cmpfloat((double)btf->values[((5 * 2 + 1) * 3 + 1) * 3], ==,
                      (double)value(1, 1, 5, 0));
    btf_matrix_free(btf);
}

/* 8-bit pictures are sRGB. */
static void write_png(const char *path, guint8 level) {
    guint8 rgb[TEXELS * 3];
    memset(rgb, level, sizeof rgb);
    rgb[0] = 255;
    g_assert_true(picture_write_png(path, rgb, WIDTH, HEIGHT, NULL, NULL));
}

static void write_list(const char *path, const char *text) {
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

TEST(rti) {
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("rti");
    g_autofree char *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *a = g_build_filename(dir, "a one.png", NULL);
    g_autofree char *b = g_build_filename(dir, "b.png", NULL);
    struct import_result result;
    const struct import_wish wish = {.region = {1, 1, 4, 2}};
    write_png(a, 0);
    write_png(b, 188);
    write_list(list, "2\r\nC:\\taken\\a one.png 0 0 1\r\nb.png\t0\t-0.5 0.866025\r\n");
    g_assert_true(ok(import_rti(path, list, &wish, &quietly, &result, ERR)));
    struct btf_matrix *btf = read_back(path);
    g_assert_cmpint(btf->layout.views.n, ==, 1);
    g_assert_cmpint(btf->layout.lights.n, ==, 2);
    g_assert_cmpint(btf->layout.width, ==, 4);
    g_assert_cmpint(btf->layout.height, ==, 2);
    g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.theta_deg[1], 30, 1e-3);
    g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.phi_deg[1], 270, 1e-3);
    g_assert_cmpfloat((double)btf->values[0], ==, 0);
    g_assert_cmpfloat_with_epsilon((double)btf->values[3], 0.5029,
                                   1e-3); /* ((188/255+.055)/1.055)^2.4 */
    btf_matrix_free(btf);
}

/* Camera raw: a texel is a cell of the mosaic, each filter with its own black level. */
#define RAW_WIDTH  32
#define RAW_HEIGHT 24
static const guint32 raw_black[4] = {500, 520, 530, 512}, raw_white = 15000;

/* Numbers from just below black to just beyond white. */
static guint16 raw_number(int light, int x, int y) {
    return (guint16)(480 + (light * 977 + (y * RAW_WIDTH + x) * 61) % 14600);
}

static void write_cells(const char *dir, const char *name, const char *cfa, int light) {
    g_autofree char *path = g_build_filename(dir, name, NULL);
    guint16 values[RAW_WIDTH * RAW_HEIGHT];
    struct dng dng = {
        .width = RAW_WIDTH, .height = RAW_HEIGHT, .values = values, .cfa = cfa, .white = raw_white};
    memcpy(dng.black, raw_black, sizeof raw_black);
    for (int i = 0; i < RAW_WIDTH * RAW_HEIGHT; i++)
        values[i] = raw_number(light, i % RAW_WIDTH, i / RAW_WIDTH);
    write_dng(path, &dng);
}

/* Of a cell: the mean of those of its four pixels that have the colour's filter. */
static double raw_value(const char *cfa, int light, int texel, int colour) {
    const int x0 = 2 * (texel % (RAW_WIDTH / 2)), y0 = 2 * (texel / (RAW_WIDTH / 2));
    double sum = 0;
    int n = 0;
    for (int k = 0; k < 4; k++) {
        if (cfa[k] != "rgb"[colour])
            continue;
        sum += (raw_number(light, x0 + k % 2, y0 + k / 2) - (double)raw_black[k]) /
               ((double)raw_white - raw_black[k]);
        n++;
    }
    return sum / n;
}

static void assert_raw(const char *path, const char *const *cfa, int lights) {
    struct btf_matrix *btf = read_back(path);
    g_assert_cmpint(btf->layout.views.n, ==, 1);
    g_assert_cmpint(btf->layout.lights.n, ==, lights);
    g_assert_cmpint(btf->layout.width, ==, RAW_WIDTH / 2);
    g_assert_cmpint(btf->layout.height, ==, RAW_HEIGHT / 2);
    for (int t = 0; t < RAW_WIDTH * RAW_HEIGHT / 4; t++)
        for (int l = 0; l < lights; l++)
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon((double)btf->values[(t * lights + l) * 3 + c],
                                               raw_value(cfa[l], l, t, c), 5e-4);
    btf_matrix_free(btf);
}

TEST(pictures__raw) {
    static const char *const cfa[] = {"rggb", "grbg", "bggr"};
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("raw");
    struct import_result result;
    write_cells(dir, "tv015_pv000_tl000_pl000.dng", cfa[0], 0);
    write_cells(dir, "tv015_pv000_tl030_pl090.DNG", cfa[1], 1);
    write_cells(dir, "tv015_pv000_tl060_pl090.dng", cfa[2], 2);
    ok(import_pictures(path, dir, &plainly, &quietly, &result, ERR));
    g_assert_cmpint(result.holes, ==, 0);
    assert_raw(path, cfa, 3);
}

TEST(rti__raw) {
    static const char *const cfa[] = {"gbrg", "gbrg"};
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("raw_rti");
    g_autofree char *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *bad = g_build_filename(dir, "b.dng", NULL);
    struct import_result result;
    write_cells(dir, "a.dng", cfa[0], 0);
    write_cells(dir, "b.dng", cfa[1], 1);
    write_list(list, "2\na.dng 0 0 1\nb.dng 0 -0.5 0.866025\n");
    ok(import_rti(path, list, &plainly, &quietly, &result, ERR));
    assert_raw(path, cfa, 2);
    g_autofree char *refused = session_fixture_path("refused");
    write_list(bad, "not a picture");
    g_assert_false(import_rti(refused, list, &plainly, &quietly, &result, &error));
    assert_not_imported(refused, error, "b.dng is not a camera raw picture that can be read");
}

TEST(rti__bad) {
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree char *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *a = g_build_filename(dir, "a.png", NULL);
    write_png(a, 100);
    static const char *const bad[][2] = {
        {"", "lights.lp:1: the list is empty; its first line must be the number of pictures"},
        {"many\n", "lights.lp:1: “many” cannot be read; this line must be the number of pictures"},
        {"2\na.png 0 0 1\n", "lights.lp:1: this line states 2 pictures, but the file lists 1"},
        {"1\na.png 0 1\n", "lights.lp:2: “a.png 0 1” cannot be read; this line must be a picture"},
        {"1\n\na.png 0 x 1\n", "lights.lp:3: “x” is not a number"},
        {"1\na.png 0 nan 1\n", "lights.lp:2: “nan” is not a number"},
        {"1\na.png 0 1 -0.1\n", "lights.lp:2: the direction 0 1 -0.1 to the light leads below"},
        {"1\nb.png 0 0 1\n", "lights.lp:2: there is no picture"},
        {"2\na.png 0 0 1\na.png 0 0 1\n", "has the same view and light"},
        {"0\n", "lights.lp:1: the number of pictures is 0; it must be 1 to 65536"},
        {"a.png 0 1\n",
         "this line must be the number of pictures, or a picture's name and x, y, z"},
        {"1\n0 1\n",
         "lights.lp:2: “0 1” cannot be read; this line must be a picture's name and x, y, z"},
        {"0 0 1\na.png 0 0 1\n",
         "lights.lp:2: this line has a picture's name, but the first line has "},
        {"a.png 0 0 1\n0 0 1\n", "lights.lp:2: x, y, z must follow a picture's name"},
        {"0 0 1\n0 1 1\n", "the list has 2 directions without names of pictures, but "},
        {"image,theta\na.png,30\n", "lights.lp:1: "},
        {"image,theta,phi\na.png,30\n",
         "lights.lp:2: this line has 2 columns, but the first line names at least 3"},
        {"image,theta,phi\na.png,3O,0\n", "lights.lp:2: “3O” is not a number"},
        {"image,theta,phi\na.png,95,0\n",
         "lights.lp:2: theta is 95°; it is the angle from the normal"},
        {"image,theta,phi\n,5,0\n",
         "lights.lp:2: column 1 is empty, but must have a picture's name"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *path = session_fixture_path("refused");
        struct import_result result;
        write_list(list, bad[i][0]);
        g_assert_false(import_rti(path, list, &plainly, &quietly, &result, &error));
        assert_not_imported(path, error, bad[i][1]);
    }
}

/* θ and φ of each light, in order of θ, and the red value of its picture. */
static void assert_lights(const char *list, const double (*expected)[3], int n) {
    g_autofree char *path = session_fixture_path("listed");
    struct import_result result;
    ok(import_rti(path, list, &plainly, &quietly, &result, ERR));
    struct btf_matrix *btf = read_back(path);
    g_assert_cmpint(btf->layout.views.n, ==, 1);
    g_assert_cmpint(btf->layout.lights.n, ==, n);
    for (int i = 0; i < n; i++) {
        g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.theta_deg[i], expected[i][0],
                                       2e-3);
        g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.phi_deg[i], expected[i][1], 2e-3);
        g_assert_cmpfloat_with_epsilon((double)btf->values[(n + i) * 3], expected[i][2], 1e-3);
    }
    btf_matrix_free(btf);
}

/* The same three lights in each form that is published: pictures 9.png, "10 b.png" and 11.png are
 * black, of sRGB 188 (0.5029) and white. */
TEST(rti__lists) {
    static const double expected[3][3] = {{0, 0, 0}, {30, 270, 0.5029}, {60, 90, 1}};
    static const char *const names[] = {"9.png", "10 b.png", "11.png"};
    static const char *const forms[][2] = {
        {"set.lp", "3\n9.png 0 0 1\n10 b.png 0 -0.5 0.866025\n11.png 0 0.866025 0.5\n"},
        {"set.lp", "9.png 0 0 1\n10 b.png 0 -0.5 0.866025\n11.png 0 0.866025 0.5"},
        {"set.lp", "\xef\xbb\xbf"
                   "3\r\nC:\\My sets\\9.png 0 0 1\r\n"
                   "C:\\My sets\\10 b.png\t0\t-0.5\t0.866025\r\n/home/me/11.png 0 .866025 .5\r\n"},
        {"lights.txt", "0 0 1\n0 -0.5 0.866025\n0 0.866025 0.5\n"},
        {"lights.txt", "3\n0 0 1\n0 -0.5 0.866025\n\n0 0.866025 0.5\n"},
        {"light_directions.txt", "# x y z\n 0.0e+00 0 2\n0,-1,1.73205\n0;1.73205;1\n"},
        {"lights.csv", "theta,phi\n0,0\n30,270\n60,90\n"},
        {"lights.csv", "\"Filename\",\"Theta (deg)\",\"Phi (deg)\"\n11.png,60,90\n9.png,0,45\n"
                       "\"10 b.png\",30,-90\n"},
        {"lights.csv", "phi_rad;theta_rad;image\n0;0;9.png\n4.712389;0.5235988;10 b.png\n"
                       "1.570796;1.047198;11.png\n"},
        {"lights.csv", "image\tx\ty\tz\n9.png\t0\t0\t1\n10 b.png\t0\t-0.5\t0.866025\n"
                       "11.png\t0\t0.866025\t0.5\n"},
    };
    g_autofree char *dir = session_fixture_new_folder();
    for (int i = 0; i < 3; i++) {
        g_autofree char *path = g_build_filename(dir, names[i], NULL);
        guint8 rgb[TEXELS * 3];
        memset(rgb, (const guint8[]){0, 188, 255}[i], sizeof rgb);
        g_assert_true(picture_write_png(path, rgb, WIDTH, HEIGHT, NULL, NULL));
    }
    for (gsize i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_autofree char *list = g_build_filename(dir, forms[i][0], NULL);
        write_list(list, forms[i][1]);
        assert_lights(list, expected, 3);
    }
    /* filenames.txt says the order, and leaves out what is no picture of the set. */
    static const double turned[3][3] = {{0, 0, 1}, {30, 270, 0.5029}, {60, 90, 0}};
    g_autofree char *order = g_build_filename(dir, "filenames.txt", NULL);
    g_autofree char *mask = g_build_filename(dir, "mask.png", NULL);
    g_autofree char *list = g_build_filename(dir, "light_directions.txt", NULL);
    write_png(mask, 7);
    write_list(list, forms[3][1]);
    write_list(order, "11.png\n10 b.png\n9.png\n");
    assert_lights(list, turned, 3);
}

/* Largest memory of "mesorig import rti" of n pictures of a list, in KiB. */
static long peak_kib(const char *dir, int n, const char *region) {
    g_autofree char *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *path = session_fixture_path("peak");
    g_autoptr(GString) text = g_string_new(NULL);
    g_auto(GStrv) environment =
        g_environ_setenv(g_get_environ(), "ASAN_OPTIONS",
                         "quarantine_size_mb=1:thread_local_quarantine_size_kb=1", TRUE);
    const char *argv[] = {BUILD_DIR "/bin/mesorig",   "import", "rti", list, "-o", path,
                          region ? "--region" : NULL, region,   NULL};
    GPid pid;
    int status = 0;
    for (int i = 0; i < n; i++)
        g_string_append_printf(text, "noise.png %g 0 1\n", i * 0.01);
    write_list(list, text->str);
    g_assert_true(g_spawn_async(NULL, (char **)argv, environment,
                                G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_STDOUT_TO_DEV_NULL, NULL, NULL,
                                &pid, NULL));
    /* What wait4() tells begins with the memory of this process. */
    g_autofree char *about = g_strdup_printf("/proc/%d/status", pid);
    long peak = 0;
    while (waitpid(pid, &status, WNOHANG) == 0) {
        g_autofree char *now = NULL;
        const char *line = NULL;
        if (g_file_get_contents(about, &now, NULL, NULL) && (line = strstr(now, "VmHWM:")))
            peak = strtol(line + strlen("VmHWM:"), NULL, 10);
        g_usleep(1000);
    }
    g_assert_cmpint(status, ==, 0);
    return peak;
}

/* Memory does not grow with the number of pictures, and a region takes less. */
TEST(rti__memory) {
    enum { PICTURE_WIDTH = 1200, PICTURE_HEIGHT = 800 };
    const long picture_kib = PICTURE_WIDTH * PICTURE_HEIGHT * 3L * (long)sizeof(float) / 1024;
    g_autofree char *dir = session_fixture_new_folder(),
                    *noise = g_build_filename(dir, "noise.png", NULL);
    g_autofree guint8 *rgb = g_new(guint8, PICTURE_WIDTH * PICTURE_HEIGHT * 3);
    GRand *rand = g_rand_new_with_seed(5);
    for (int i = 0; i < PICTURE_WIDTH * PICTURE_HEIGHT * 3; i++)
        rgb[i] = (guint8)g_rand_int_range(rand, 100, 104);
    g_rand_free(rand);
    g_assert_true(picture_write_png(noise, rgb, PICTURE_WIDTH, PICTURE_HEIGHT, NULL, NULL));
    const long two = peak_kib(dir, 2, NULL), eight = peak_kib(dir, 8, NULL);
    const long region = peak_kib(dir, 8, "700,300,20,10");
    g_test_message("2 pictures %ld KiB, 8 pictures %ld KiB, region of 8 %ld KiB", two, eight,
                   region);
    g_assert_cmpint(eight - two, <, picture_kib);
    g_assert_cmpint(region, <, two);
}

enum { LARGE_WIDTH = 10100, LARGE_HEIGHT = 10000 };

/* 101 megapixels, black but for a square of 100 pixels at 9000, 9000: R rises with x, G with y. */
static void write_large_png(const char *path, int bits) {
    FILE *file = fopen(path, "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    const gsize bytes = (gsize)bits / 8, row = 3 * bytes * LARGE_WIDTH;
    g_autofree guint8 *black = g_malloc0(row), *square = g_malloc0(row);
    png_init_io(png, file);
    png_set_IHDR(png, info, LARGE_WIDTH, LARGE_HEIGHT, bits, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png, 1);
    png_set_filter(png, 0, PNG_FILTER_NONE);
    png_write_info(png, info);
    for (int y = 0; y < LARGE_HEIGHT; y++) {
        const gboolean in = y >= 9000 && y < 9100;
        for (int x = 9000; in && x < 9100; x++) {
            square[(3 * (gsize)x) * bytes] = (guint8)(100 + x - 9000);
            square[(3 * (gsize)x + 1) * bytes] = (guint8)(100 + y - 9000);
        }
        png_write_row(png, in ? square : black);
    }
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    fclose(file);
}

/* Of a PNG that is too large to be decoded as a whole, a region is. */
TEST(rti__large) {
    g_autofree char *dir = session_fixture_new_folder(),
                    *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *png = g_build_filename(dir, "large.png", NULL);
    for (int bits = 8; bits <= 16; bits += 8) {
        g_autofree char *path = session_fixture_path("large");
        g_autoptr(GError) error = NULL;
        struct import_result result;
        write_large_png(png, bits);
        write_list(list, "large.png 0 0 1\n");
        const struct import_wish whole = {.transfer = PICTURE_TONES_LINEAR};
        g_assert_false(import_rti(path, list, &whole, &quietly, &result, &error));
        assert_has(error->message, "10100 × 10000 pixels");
        assert_has(error->message, "--region");
        const struct import_wish wish = {.transfer = PICTURE_TONES_LINEAR,
                                         .region = {9002, 9005, 4, 3}};
        g_clear_error(&error);
        g_assert_true(ok(import_rti(path, list, &wish, &quietly, &result, ERR)));
        struct btf_matrix *btf = read_back(path);
        g_assert_cmpuint(btf->layout.width, ==, 4);
        g_assert_cmpuint(btf->layout.height, ==, 3);
        const double most = bits == 8 ? 255 : 65535, step = bits == 8 ? 1 : 256;
        for (int k = 0; k < 12; k++) {
            g_assert_cmpfloat_with_epsilon(btf->values[3 * k], (102 + k % 4) * step / most, 1e-3);
            g_assert_cmpfloat_with_epsilon(btf->values[3 * k + 1], (105 + k / 4) * step / most,
                                           1e-3);
            g_assert_cmpfloat_with_epsilon(btf->values[3 * k + 2], 0, 1e-6);
        }
        btf_matrix_free(btf);
        const struct import_wish outside = {.region = {LARGE_WIDTH - 2, 0, 4, 3}};
        g_autoptr(GError) refused = NULL;
        g_assert_false(import_rti(path, list, &outside, &quietly, &result, &refused));
    }
    /* Its memory is that of a region of a small picture. */
    g_autofree char *noise = g_build_filename(dir, "noise.png", NULL);
    static const guint8 rgb[64 * 64 * 3];
    g_assert_true(picture_write_png(noise, rgb, 64, 64, NULL, NULL));
    const long small_kib = peak_kib(dir, 2, "10,10,20,10");
    g_assert_cmpint(g_rename(png, noise), ==, 0);
    const long large_kib = peak_kib(dir, 2, "9000,9000,20,10");
    g_test_message("a region of 64 × 64 pixels %ld KiB, of 101 megapixels %ld KiB", small_kib,
                   large_kib);
    g_assert_cmpint(large_kib - small_kib, <, 16 << 10);
}

/* Whatever bytes a list has, it is a list or an error. */
TEST(rti__mutated) {
    static const char *const good = "2\na.png 0 0 1\na.png 0.5 0 0.866\n";
    g_autofree char *dir = session_fixture_new_folder();
    g_autofree char *list = g_build_filename(dir, "lights.lp", NULL);
    g_autofree char *a = g_build_filename(dir, "a.png", NULL);
    GRand *rand = g_rand_new_with_seed(3);
    write_png(a, 100);
    for (int i = 0; i < 150; i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *text = g_strdup(good), *path = session_fixture_path("mutated");
        struct import_result result;
        for (int k = g_rand_int_range(rand, 1, 6); k > 0; k--)
            text[g_rand_int_range(rand, 0, (int)strlen(good))] =
                (char)g_rand_int_range(rand, i % 2, 256);
        write_list(list, text);
        const gboolean ok = import_rti(path, list, &plainly, &quietly, &result, &error);
        g_assert_true(ok == (error == NULL));
    }
    g_rand_free(rand);
}

static void write_bonn(const char *path, gboolean cosine) {
    float view_theta[2] = {0, 45}, view_phi[2] = {0, 90}, light_theta[3] = {0, 60, 75};
    float light_phi[3] = {0, 120, 240};
    struct bonn_header header = {.kind = BONN_BDI,
                                 .texels_a_mm = 4,
                                 .rgb_scale = {1, 1, 1},
                                 .cosine = cosine,
                                 .width = WIDTH,
                                 .height = HEIGHT,
                                 .n_views = 2,
                                 .n_lights = 3,
                                 .view_theta_deg = view_theta,
                                 .view_phi_deg = view_phi,
                                 .light_theta_deg = light_theta,
                                 .light_phi_deg = light_phi};
    float rgb[3 * TEXELS * 3];
    g_autoptr(GError) error = NULL;
    g_autoptr(BonnWriter) writer = bonn_writer_new(path, &header, NULL, &error);
    g_assert_no_error(error);
    for (int v = 0; v < 2; v++) {
        for (int i = 0; i < 3 * TEXELS * 3; i++)
            rgb[i] = value(v, i / 3 / TEXELS, i / 3 % TEXELS, i % 3);
        g_assert_true(bonn_writer_view(writer, v, rgb, &error));
    }
    g_assert_true(bonn_writer_finish(writer, &error));
}

TEST(bonn) {
    g_autofree char *file = in_folder("a.btf");
    for (int cosine = 0; cosine < 2; cosine++) {
        g_autofree char *path = session_fixture_path("bonn");
        struct import_result result;
        write_bonn(file, cosine);
        g_assert_true(ok(import_bonn(path, file, &plainly, &quietly, &result, ERR)));
        struct btf_matrix *btf = read_back(path);
        g_assert_cmpfloat(btf->layout.texel_mm, ==, 0.25);
        g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.phi_deg[2], 240, 1e-4);
        const double here = (double)btf->values[((7 * 2 + 1) * 3 + 1) * 3 + 2];
        g_assert_cmpfloat_with_epsilon(here, (double)value(1, 1, 7, 2) * (cosine ? 1 : 0.5), 1e-3);
        btf_matrix_free(btf);
    }
}

/* A session's BTF written and read again; and in factors, with all there are. */
TEST(export_bonn) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("exported");
    struct import_result result;
    struct export_bonn_result exported;
    const struct import_wish wish = {.texel_mm = 0.5};
    write_set(dir);
    g_assert_true(import_pictures(path, dir, &wish, &quietly, &result, &error));
    for (enum bonn_kind kind = BONN_BDI; kind <= BONN_DFMF; kind++) {
        g_autofree char *file = in_folder("exported.btf");
        if (kind == BONN_BDI_SPARSE)
            continue;
        g_assert_true(ok(export_bonn(path, file, kind, 18, &quietly, &exported, ERR)));
        g_assert_cmpfloat(exported.error, <, 1e-3);
        g_autoptr(BonnFile) btf = bonn_open(file, &error);
        g_assert_no_error(error);
        g_assert_cmpint(bonn_header(btf)->kind, ==, kind);
        g_assert_cmpfloat_with_epsilon(bonn_header(btf)->texels_a_mm, 2, 1e-6);
        float rgb[3 * TEXELS * 3];
        int holes[3];
        g_assert_true(ok(bonn_read_view(btf, 1, rgb, holes, ERR)));
        for (int i = 0; i < 3 * TEXELS * 3; i++)
            g_assert_cmpfloat_with_epsilon((double)rgb[i],
                                           (double)value(1, i / 3 / TEXELS, i / 3 % TEXELS, i % 3),
                                           kind == BONN_BDI ? 1e-9 : 4e-3);
    }
    g_assert_false(export_bonn(session_fixture_folder, "/nonexistent/a.btf", BONN_BDI, 0, &quietly,
                               &exported, &error));
    g_assert_nonnull(error);
}

TEST(exists) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = session_fixture_new_folder();
    struct import_result result;
    const struct import_wish outside = {.region = {3, 0, WIDTH, HEIGHT}};
    write_set(dir);
    g_assert_false(import_pictures(dir, dir, &plainly, &quietly, &result, &error));
    assert_error_clear(&error, DATA_ERROR, DATA_ERROR_EXISTS);
    g_autofree char *path = session_fixture_path("outside");
    g_assert_false(import_pictures(path, dir, &outside, &quietly, &result, &error));
    assert_not_imported(path, error, "does not lie within the 6 × 4 texels of the file");
}

TEST(cancelled) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("cancelled");
    struct import_result result;
    const struct work progress = {.cancellable = cancellable};
    write_set(dir);
    g_cancellable_cancel(cancellable);
    g_assert_false(import_pictures(path, dir, &plainly, &progress, &result, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    assert_not_imported(path, error, "");
}

/* The last report of each stage, by its name. */
static void keep_last(const struct work_progress *progress, gpointer data) {
    g_hash_table_insert(data, g_strdup(progress->stage), g_memdup2(progress, sizeof *progress));
}

/* Each stage ends with all of it done. */
TEST(progress) {
    g_autoptr(GHashTable) last = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    g_autofree char *dir = session_fixture_new_folder(), *path = session_fixture_path("progress");
    struct import_result result;
    const struct work work = {.progress = keep_last, .data = last};
    static const char *const stages[] = {"import", "eigenmaps"};
    write_set(dir);
    ok(import_pictures(path, dir, &plainly, &work, &result, ERR));
    for (gsize i = 0; i < G_N_ELEMENTS(stages); i++) {
        const struct work_progress *end = g_hash_table_lookup(last, stages[i]);
        g_assert_nonnull(end);
        g_assert_cmpint(end->done, ==, end->total);
    }
}

TEST(command) {
    g_autofree char *file = in_folder("command.btf"), *path = session_fixture_path("command");
    g_autofree char *back = in_folder("back.btf");
    write_bonn(file, TRUE);
    g_autofree char *imported = process_mesorig(0, "import btf %s -o %s --json", file, path);
    g_autofree char *again = process_mesorig(1, "import btf %s -o %s --json", file, path);
    g_assert_nonnull(strstr(imported, "\"views\": 2"));
    g_assert_nonnull(strstr(again, "exists already"));
    g_autofree char *processed = process_mesorig(1, "process %s --json", path);
    g_assert_nonnull(strstr(processed, "there is nothing to process"));
    g_free(process_mesorig(0, "compress %s -k 2 --components 2 --json", path));
    g_free(process_mesorig(0, "info %s --json", path));
    g_free(process_mesorig(0, "export btf %s -o %s --json", path, back));
    g_free(process_mesorig(2, "import btf --json"));
    g_free(process_mesorig(2, "import nothing here -o there"));
    g_autofree char *a = NULL, *b = NULL;
    gsize n_a, n_b;
    g_assert_true(g_file_get_contents(file, &a, &n_a, NULL));
    g_assert_true(g_file_get_contents(back, &b, &n_b, NULL));
    g_assert_cmpmem(a + n_a - 200, 200, b + n_b - 200, 200);
}

TESTS_RUN_BY(session_fixture_run);
