/* Normal maps from files, whole and broken, and metal under them against microfacet_evaluate(). */
#include "drawing/methods/normal_map.h"
#include "exr/exr.h"
#include "lib/formula_fixture.h"
#include "lib/microfacet_formula.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <png.h>
#include <string.h>

#define W 12
#define H 5

static char *folder, *path;

static void name_file(const char *name) {
    g_free(path);
    path = g_build_filename(folder, name, NULL);
}

/* A normal for each texel, different from those of its neighbours. */
static struct vec3 normal_at(int k) {
    return vec3_unit(vec3(0.6 * sin(1.7 * k), 0.5 * cos(0.9 * k), 1));
}

static double coded(int k, int c) {
    const struct vec3 n = normal_at(k);
    return 0.5 + 0.5 * (c == 0 ? n.x : c == 1 ? n.y : n.z);
}

static void write_png(int format, const void *pixels) {
    png_image image = {.version = PNG_IMAGE_VERSION, .width = W, .height = H};
    image.format = (png_uint_32)format;
    g_assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, NULL));
}

/* With an alpha, which is passed over. */
static void write_words(void) {
    guint16 pixels[4 * W * H];
    for (int k = 0; k < 4 * W * H; k++)
        pixels[k] = k % 4 < 3 ? (guint16)lrint(65535 * coded(k / 4, k % 4)) : 65535;
    write_png(PNG_FORMAT_LINEAR_RGB_ALPHA, pixels);
}

static void write_exr(const char *part_name, const char *const *channels, gboolean plain,
                      double spoil) {
    g_autoptr(GError) error = NULL;
    static const char *const grey[] = {"Y", NULL};
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new(part_name, W, H, channels, EXR_FLOAT);
    for (int k = 0; k < W * H; k++)
        for (int c = 0; c < 3; c++) {
            /* Channels are in order of their names: B G R, or X Y Z. */
            const int of = plain ? c : 2 - c;
            part->planes[c][k] = (float)(plain ? 2 * coded(k, of) - 1 : coded(k, of));
        }
    if (spoil != 0)
        part->planes[0][W + 2] = (float)spoil;
    exr_file_add(file, exr_part_new("before", 3, 3, grey, EXR_HALF));
    if (strcmp(part_name, "normal") != 0)
        g_ptr_array_set_size(file->parts, 0);
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
}

static const char *const xyz[] = {"X", "Y", "Z", NULL}, *const bgr[] = {"B", "G", "R", NULL};

static void check_read(double tolerance) {
    struct normal_map *map = ok(normal_map_read(path, ERR));
    g_assert_cmpint(map->width, ==, W);
    g_assert_cmpint(map->height, ==, H);
    for (int k = 0; k < W * H; k++) {
        g_assert_cmpfloat_with_epsilon(map->xy[2 * k], normal_at(k).x, tolerance);
        g_assert_cmpfloat_with_epsilon(map->xy[2 * k + 1], normal_at(k).y, tolerance);
    }
    normal_map_free(map);
    g_assert_cmpint(g_unlink(path), ==, 0);
}

TEST(read) {
    name_file("map.png");
    guint8 pixels[3 * W * H];
    for (int k = 0; k < 3 * W * H; k++)
        pixels[k] = (guint8)lrint(255 * coded(k / 3, k % 3));
    write_png(PNG_FORMAT_RGB, pixels);
    check_read(1.1 / 255);
    write_words();
    check_read(2.0 / 65535);
    name_file("map.EXR");
    write_exr("normal", xyz, TRUE, 0);
    check_read(1e-6);
    write_exr("any", bgr, FALSE, 0);
    check_read(1e-6);
}

static void refuse(const char *said) {
    g_autoptr(GError) error = NULL;
    g_assert_null(normal_map_read(path, &error));
    g_assert_nonnull(error);
    if (strstr(error->message, said) == NULL)
        g_error("“%s” was expected in “%s”", said, error->message);
    g_unlink(path);
}

TEST(bad) {
    guint8 pixels[3 * W * H] = {0};
    name_file("map.png");
    refuse("cannot read ");
    write_png(PNG_FORMAT_GRAY, pixels);
    refuse("the PNG is grey");
    write_png(PNG_FORMAT_RGB, pixels);
    refuse("texel (0, 0) is (-1, -1, -1)");
    memset(pixels, 128, sizeof pixels); /* a photograph, not a map */
    write_png(PNG_FORMAT_RGB, pixels);
    refuse("not the normal of a surface");
    g_assert_true(g_file_set_contents(path, "no picture at all", -1, NULL));
    refuse("map.png cannot be read");
    name_file("map.exr");
    write_exr("normal", xyz, TRUE, NAN);
    refuse("texel (2, 1) is (nan");
    write_exr("normal", xyz, TRUE, 4);
    refuse("texel (2, 1)");
    static const char *const other[] = {"A", "B", "C", NULL};
    write_exr("any", other, TRUE, 0);
    refuse("X, Y, Z");
}

TEST(cut) {
    g_autofree char *bytes = NULL;
    gsize length;
    name_file("map.png");
    write_words();
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    for (gsize cut = 0; cut < length; cut += 7) {
        g_assert_true(g_file_set_contents(path, bytes, (gssize)cut, NULL));
        refuse("map.png cannot be read");
    }
}

struct scene {
    enum microfacet_model model;
    enum method_rotation rotation;
};

static gboolean expected(gconstpointer data, const float *at, const float *v, const float *l,
                         double ret[3]) {
    const struct scene *s = data;
    struct microfacet here;
    struct vec3 bosses;
    const double x = at[0] * (double)W, y = at[1] * (double)H, none[2] = {0, 0};
    if (fabs(x - round(x)) < 0.03 || fabs(y - round(y)) < 0.03 || v[2] < 0.1 || l[2] < 0.1)
        return FALSE;
    const int i = (int)floor(x) % W, j = (int)floor(y) % H;
    const struct vec3 n = normal_at((i + W) % W + W * ((j + H) % H));
    microfacet_surface_at(MICROFACET_METAL, s->model, none, &here, &bosses);
    microfacet_evaluate(&here, n, vec3(v[0], v[1], v[2]), vec3(l[0], l[1], l[2]), s->rotation, ret);
    return TRUE;
}

GPU_TEST(pictures) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1, 0.4, 128, 64);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_assert_no_error(error);
    formula_start_view(view, &settings, mesh);
    settings.style.nearest = TRUE;
    settings.ambient = 0;
    name_file("map.exr");
    write_exr("normal", xyz, TRUE, 0);
    for (int k = 0; k < 2 * METHOD_ROTATIONS; k++) {
        const struct scene scene = {(enum microfacet_model)(k / METHOD_ROTATIONS),
                                    (enum method_rotation)(k % METHOD_ROTATIONS)};
        const struct method *method = &methods_microfacet[scene.model];
        g_assert_true(method->takes_normals);
        g_assert_true(viewer_open(view, method, path, &error));
        settings.style.rotation = scene.rotation;
        g_test_message("%s, rotation %d", method->name, scene.rotation);
        formula_compare(expected, &scene, view, &settings);
    }
    g_unlink(path);
    g_assert_false(viewer_open(view, &methods_microfacet[0], path, &error));
    g_assert_nonnull(strstr(error->message, "map.exr"));
    g_clear_error(&error);
    g_assert_true(viewer_open(view, &methods_microfacet[0], methods_microfacet[0].name, &error));
}

/* As a command. */
static int run_viewer(const char *const *arguments, char **ret_said) {
    g_autofree const char **argv = process_argv(BUILD_DIR "/bin/mesorig-view", arguments);
    return process_run(argv, NULL, ret_said);
}

GPU_TEST(command) {
    name_file("map.exr");
    g_autofree char *picture = g_build_filename(folder, "metal.png", NULL);
    const char *const good[] = {
        "--method", "metal-ward", "--normal-map",  path, "--size", "40x30", "--shape", "plane",
        "-o",       picture,      "--supersample", "1",  NULL};
    const char *const wrong[] = {"--method", "fabric-ward", "--normal-map", path, "-o",
                                 picture,    NULL};
    g_autofree char *said = NULL;
    g_autofree char *why = NULL;
    g_autofree char *missing = NULL;
    write_exr("normal", xyz, TRUE, 0);
    g_assert_cmpint(run_viewer(good, &said), ==, 0);
    g_assert_cmpint(g_unlink(picture), ==, 0);
    g_assert_cmpint(run_viewer(wrong, &why), ==, 2);
    g_assert_nonnull(strstr(why, "--normal-map needs"));
    g_unlink(path);
    g_assert_cmpint(run_viewer(good, &missing), ==, 1);
    g_assert_nonnull(strstr(missing, "map.exr"));
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("normals-XXXXXX", NULL);
}

AFTER_TESTS {
    g_rmdir(folder);
    g_free(folder);
    g_free(path);
}
