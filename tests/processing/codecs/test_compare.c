#include "base/data_error.h"
#include "codecs/codec/compare.h"
#include "codecs/codecs.h"
#include "codecs/eigenmaps/eigenmaps.h"
#include "codecs/lobes/lobes_codec.h"
#include "codecs/lobes/lobes_levels.h"
#include "formats/compare_pictures.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include "exr/exr.h"
#include "lib/btf_fixture.h"
#include "scene/picture.h"

#include <glib/gstdio.h>
#include <math.h>
#include <png.h>
#include <string.h>

static struct btf_matrix *new_btf(int width, int height, int n_views, int n_lights) {
    struct btf_matrix *btf =
        btf_fixture_of("small", width, height, btf_fixture_line(n_views, 20, 50),
                       btf_fixture_line(n_lights, 15, 80));
    const gsize n = btf_layout_texels(&btf->layout) * btf_layout_values(&btf->layout);
    GRand *random = g_rand_new_with_seed(1);
    for (gsize i = 0; i < n; i++)
        btf->values[i] = (float)g_rand_double_range(random, 0.1, 0.6);
    g_rand_free(random);
    return btf;
}

/* One view is brighter by a tenth of itself, one light darker by 0.05 everywhere else. */
TEST(sums) {
    struct btf_matrix *a = new_btf(4, 3, 3, 4), *b = new_btf(4, 3, 3, 4);
    for (int i = 0; i < 12 * 12 * 3; i++) {
        const int view = i / 12 % 3, light = i / 3 % 4;
        if (view == 1)
            b->values[i] *= 1.1F;
        else if (light == 2)
            b->values[i] -= 0.05F;
    }
    g_autoptr(GError) error = NULL;
    g_autoptr(Material) of_a = material_new("a", &material_btf_codec, a),
                        of_b = material_new("b", &material_btf_codec, b);
    struct comparison *c = ok(compare_materials(of_a, of_b, NULL, ERR));
    g_assert_cmpfloat_with_epsilon(c->views[1].error, 0.1, 1e-5);
    g_assert_cmpfloat(c->lights[0].error, >, 0.02);
    g_assert_cmpfloat(c->lights[0].error, <, 0.1);
    g_assert_cmpfloat_with_epsilon(c->views[0].luminance_error, 0.05 / 4, 1e-6);
    g_assert_cmpfloat(c->views[0].delta_e, >, 0.1);
    g_assert_cmpfloat(c->views[0].delta_e, <, 3);
    g_assert_cmpfloat_with_epsilon(c->largest, 0.06, 0.002);
    double weighted = 0;
    for (int i = 0; i < 3; i++)
        weighted += c->views[i].luminance_error / 3;
    g_assert_cmpfloat_with_epsilon(c->all.luminance_error, weighted, 1e-9);
    comparison_free(c);
    c = compare_materials(of_a, of_a, NULL, &error);
    g_assert_cmpfloat(c->all.error, ==, 0);
    g_assert_cmpfloat(c->all.delta_e, ==, 0);
    comparison_free(c);
}

/* Exact models give no error at all. */
static struct eigenmaps *exact_maps(const struct btf_matrix *btf) {
    const gsize texels = btf_layout_texels(&btf->layout), lights = btf->layout.lights.n;
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    maps->name = g_strdup("small");
    maps->layout = btf_layout_copy(&btf->layout);
    maps->n_terms = (int)btf->layout.views.n;
    maps->weights = g_new0(float, btf->layout.views.n * btf->layout.views.n);
    maps->maps = g_new0(float, texels *lights * btf->layout.views.n * 3);
    for (gsize view = 0; view < btf->layout.views.n; view++) {
        maps->weights[view * btf->layout.views.n + view] = 1;
        for (gsize i = 0; i < texels * lights * 3; i++)
            maps->maps[view * texels * lights * 3 + i] =
                btf->values[((i / 3 % texels * btf->layout.views.n + view) * lights +
                             i / 3 / texels) *
                                3 +
                            i % 3];
    }
    return maps;
}

TEST(kinds) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf(4, 3, 3, 4);
    const struct lpca_options options = {.n_clusters = 1, .n_components = 11};
    struct lpca *lpca = lpca_compute(btf, &options, &error);
    const struct lobes_options ptm = {.model = LOBES_PTM};
    struct lobes *lobes = lobes_compute(btf, &ptm, &error);
    const double lobes_error = lobes->error;
    g_autoptr(Material) of_btf = material_new("btf", &material_btf_codec, btf);
    struct eigenmaps *maps = exact_maps(btf);
    g_assert_true(lpca_write(path, lpca, &error));
    lpca_free(lpca);
    Material *material = material_open(path, NULL, &error);
    struct comparison *c = ok(compare_materials(of_btf, material, NULL, ERR));
    g_assert_cmpstr(material_info(material)->kind, ==, "lpca");
    g_assert_cmpfloat(c->all.error, <, 1e-3);
    comparison_free(c);
    material_free(material);
    g_assert_true(eigenmaps_write(path, maps, &error));
    eigenmaps_free(maps);
    material = material_open(path, NULL, &error);
    c = ok(compare_materials(of_btf, material, NULL, ERR));
    g_assert_cmpfloat(c->all.error, <, 1e-3);
    comparison_free(c);
    material_free(material);
    g_assert_true(lobes_write_levels(path, &lobes, 1, &error));
    lobes_free(lobes);
    material = material_open(path, NULL, &error);
    c = ok(compare_materials(of_btf, material, NULL, ERR));
    g_assert_cmpfloat_with_epsilon(c->all.error, lobes_error, 1e-6);
    comparison_free(c);
    material_free(material);
}

static void assert_refused(int width, int n_views, float turn_deg, const char *what) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *other = new_btf(width, 3, n_views, 4);
    other->layout.lights.phi_deg[2] += turn_deg;
    g_autoptr(Material) a = material_new("a", &material_btf_codec, new_btf(4, 3, 3, 4));
    g_autoptr(Material) b = material_new("b", &material_btf_codec, other);
    g_assert_null(compare_materials(a, b, NULL, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, what));
}

/* Ward's model of a roughness of 0 divides by it. */
TEST(not_finite) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf(4, 3, 3, 4);
    const struct lobes_options options = {.model = LOBES_WARD};
    struct lobes *lobes = ok(lobes_compute(btf, &options, ERR));
    lobes->values[7 * lobes->n_values + 12] = 0; /* texel (3, 1) */
    g_autoptr(Material) a = material_new("a", &material_btf_codec, btf),
                        b = material_new("ward.exr", &lobes_codecs[LOBES_WARD], lobes);
    g_assert_null(compare_materials(a, b, NULL, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(
        strstr(error->message, "ward.exr: the texel in column 3 and row 1, counted from 0, "));
}

TEST(refused) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(GError) error = NULL;
    assert_refused(5, 3, 0, "numbers of texels");
    assert_refused(4, 2, 0, "different views");
    assert_refused(4, 3, 0.1F, "different lights");
    g_assert_null(material_open(path, NULL, &error));
    g_clear_error(&error);
    static const char *const channels[] = {"R", NULL};
    for (int i = 0; i < 2; i++) {
        struct exr_file *file = exr_file_new();
        struct exr_part *part = exr_part_new("p", 2, 2, channels, EXR_HALF);
        if (i)
            exr_set_string(part, "mesorig.kind", "mdf");
        exr_file_add(file, part);
        g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
        exr_file_free(file);
        g_assert_null(material_open(path, NULL, &error));
        g_assert_error(error, EXR_ERROR, EXR_ERROR_FORMAT);
        g_clear_error(&error);
    }
}

/* 4 × 2 pixels of sRGB; those of a column are grey. */
static void write_png(const char *path, int width, const guint8 *columns) {
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (png_uint_32)width,
                       .height = 2,
                       .format = PNG_FORMAT_RGB};
    g_autofree guint8 *pixels = g_new(guint8, (gsize)(width * 2) * 3);
    for (int i = 0; i < width * 2; i++)
        memset(pixels + (gsize)i * 3, columns[i % width], 3);
    g_assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, NULL));
}

static double lightness(guint8 srgb) {
    const double v = srgb / 255.0,
                 linear = v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
    return 116 * cbrt(linear) - 16;
}

/* Of greys the formula has nothing but lightness. */
static double grey_delta_e(guint8 a, guint8 b) {
    const double mean = (lightness(a) + lightness(b)) / 2, away = (mean - 50) * (mean - 50);
    return fabs(lightness(a) - lightness(b)) / (1 + 0.015 * away / sqrt(20 + away));
}

/* As light, of the same greys. */
static void write_exr(const char *path, int width, const guint8 *columns) {
    g_autofree float *rgb = g_new(float, 3 * 2 * width);
    for (int i = 0; i < 3 * 2 * width; i++) {
        const double v = columns[i / 3 % width] / 255.0;
        rgb[i] = (float)(v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4));
    }
    const char *texts[] = {"Shape", "torus", "Tiles", "8 x 3", NULL};
    g_assert_true(picture_write_exr(path, rgb, width, 2, texts, NULL));
}

TEST(light) {
    static const guint8 one[] = {30, 100, 150, 200}, other[] = {30, 104, 150, 190};
    TEMPORARY_FOLDER(folder);
    g_autofree char *a = g_build_filename(folder, "a.exr", NULL);
    g_autofree char *b = g_build_filename(folder, "b.exr", NULL);
    struct picture_comparison found;
    write_exr(a, 4, one);
    write_exr(b, 4, other);
    g_assert_true(compare_is_picture(a));
    g_assert_true(compare_pictures(a, b, &found, NULL));
    g_assert_cmpfloat_with_epsilon(found.delta_e,
                                   (grey_delta_e(100, 104) + grey_delta_e(200, 190)) / 4, 0.01);
    struct exr_part *part = exr_read_part(a, "picture", NULL);
    const char *shape = NULL;
    g_assert_true(exr_get_string(part, "picture.shape", &shape, NULL));
    g_assert_cmpstr(shape, ==, "torus");
    exr_part_free(part);
    g_autofree char *shouted = g_build_filename(folder, "SHOUTED.EXR", NULL);
    write_exr(shouted, 4, one);
    g_assert_true(compare_is_picture(shouted));
    g_assert_true(g_file_set_contents(shouted, "no EXR", -1, NULL));
    g_assert_false(compare_is_picture(shouted));
}

TEST(pictures) {
    static const guint8 one[] = {30, 100, 150, 200}, other[] = {30, 104, 150, 190};
    TEMPORARY_FOLDER(folder);
    g_autofree char *a = g_build_filename(folder, "a.png", NULL);
    g_autofree char *b = g_build_filename(folder, "b.png", NULL);
    g_autoptr(GError) error = NULL;
    struct picture_comparison found;
    write_png(a, 4, one);
    write_png(b, 4, other);
    g_assert_true(ok(compare_pictures(a, b, &found, ERR)));
    const double first = grey_delta_e(100, 104), last = grey_delta_e(200, 190);
    g_assert_cmpint(found.width, ==, 4);
    g_assert_cmpfloat_with_epsilon(found.delta_e, (first + last) / 4, 0.01);
    g_assert_cmpfloat_with_epsilon(found.delta_e_different, (first + last) / 2, 0.01);
    g_assert_cmpfloat_with_epsilon(found.different, 0.5, 1e-9);
    g_assert_cmpfloat_with_epsilon(found.largest, MAX(first, last), 0.01);
    write_png(b, 3, other);
    g_assert_false(compare_pictures(a, b, &found, &error));
    g_assert_nonnull(strstr(error->message, "3 × 2; give two pictures of the same size"));
    g_clear_error(&error);
    g_assert_true(g_file_set_contents(b, "\x89PNG", -1, NULL));
    g_assert_false(compare_pictures(a, b, &found, &error));
    g_assert_nonnull(strstr(error->message, "b.png"));
}
