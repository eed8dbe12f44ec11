/* mesorig_material_sample() and mesorig_material_pdf() on files of every codec: estimates with them
 * are those of a plain integral over what mesorig_material_evaluate() says; threads; arguments. */
#include "lib/material_fixture.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <math.h>
#include <mesorig/material.h>
#include <string.h>

#define SIDE  240 /* of the plain integral */
#define DRAWN 6000

static mesorig_material *open_codec(const char *name, const char *options) {
    g_autofree char *folder = g_dir_make_tmp("material-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    struct mesorig_error error = {0};
    material_fixture_write(path, codecs_find(name), btf, options);
    mesorig_material *material = mesorig_material_open(path, NULL, &error);
    g_assert_cmpstr(error.text, ==, "");
    remove_tree(folder);
    return material;
}

static void put_direction(double z, double phi, float ret[3]) {
    ret[0] = (float)(sqrt(1 - z * z) * cos(phi));
    ret[1] = (float)(sqrt(1 - z * z) * sin(phi));
    ret[2] = (float)z;
}

/* The albedo in G and the integral of the density, over even directions. */
static void integrate(const mesorig_material *material, const float uv[2], const float view[3],
                      double *ret_albedo, double *ret_density) {
    *ret_albedo = *ret_density = 0.0;
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++) {
            float light[3], rgb[3], pdf;
            put_direction((i + 0.5) / SIDE, 2 * G_PI * (j + 0.5) / SIDE, light);
            mesorig_material_evaluate(material, 1, uv, view, light, NULL, rgb);
            mesorig_material_pdf(material, 1, uv, view, light, NULL, &pdf);
            *ret_albedo += (double)rgb[1] * 2.0 / (SIDE * SIDE);
            *ret_density += (double)pdf * 2.0 * G_PI / (SIDE * SIDE);
        }
}

static void test_codec(gconstpointer data) {
    const char *const *name = data;
    mesorig_material *material = open_codec(name[0], name[1]);
    g_autoptr(GRand) random = g_rand_new_with_seed(11);
    for (int k = 0; k < 2; k++) {
        float uv[2] = {0.3F, 0.7F}, view[3];
        double albedo, density, sum = 0.0, squares = 0.0, even = 0.0, even_squares = 0.0;
        put_direction(k == 0 ? 0.95 : 0.6, 1.0 + k, view);
        integrate(material, uv, view, &albedo, &density);
        g_assert_cmpfloat_with_epsilon(density, 1.0, 0.003);
        for (int n = 0; n < DRAWN; n++) {
            const float two[2] = {(float)(g_rand_int(random) >> 8) * 0x1p-24F,
                                  (float)(g_rand_int(random) >> 8) * 0x1p-24F};
            float light[3], rgb[3], pdf, again;
            g_assert_cmpint(mesorig_material_sample(material, 1, uv, view, NULL, two, light, &pdf),
                            ==, MESORIG_OK);
            mesorig_material_pdf(material, 1, uv, view, light, NULL, &again);
            g_assert_cmpfloat_with_epsilon(pdf, again, 1e-4F * pdf + 1e-6F);
            mesorig_material_evaluate(material, 1, uv, view, light, NULL, rgb);
            const double one = (double)rgb[1] / (G_PI * (double)pdf);
            sum += one;
            squares += one * one;
            put_direction((double)two[0], 2 * G_PI * (double)two[1], light);
            mesorig_material_evaluate(material, 1, uv, view, light, NULL, rgb);
            even += 2.0 * (double)rgb[1];
            even_squares += 4.0 * (double)rgb[1] * (double)rgb[1];
        }
        const double mean = sum / DRAWN, variance = squares / DRAWN - mean * mean;
        const double even_mean = even / DRAWN;
        g_assert_cmpfloat_with_epsilon(mean, albedo, 4 * sqrt(variance / DRAWN) + 0.002 * albedo);
        g_test_message("%s: variance %.4f, of even directions %.4f", name[0], variance,
                       even_squares / DRAWN - even_mean * even_mean);
        /* What does not fall towards the horizon, as PTMs do not, gains little. */
        const double most = g_str_equal(name[0], "ptm") ? 1.0 : 0.5;
        g_assert_cmpfloat(variance, <, most * (even_squares / DRAWN - even_mean * even_mean));
    }
    mesorig_material_close(material);
}

#define THREADS 4

struct asked {
    const mesorig_material *material;
    float light[32][3], pdf[32];
};

static gpointer ask(gpointer data) {
    struct asked *asked = data;
    for (int k = 0; k < 32; k++) {
        const float uv[2] = {0.05F * (float)k, 0.4F}, two[2] = {(float)k / 32.0F, 0.3F};
        float view[3];
        put_direction(0.8, k, view);
        mesorig_material_sample(asked->material, 1, uv, view, NULL, two, asked->light[k],
                                &asked->pdf[k]);
    }
    return NULL;
}

/* The first calls come immediately; all get the same. */
TEST(threads) {
    mesorig_material *material = open_codec("eigenmaps", "");
    struct asked asked[THREADS];
    GThread *threads[THREADS];
    for (int k = 0; k < THREADS; k++) {
        asked[k].material = material;
        threads[k] = g_thread_new("ask", ask, &asked[k]);
    }
    for (int k = 0; k < THREADS; k++)
        g_thread_join(threads[k]);
    for (int k = 1; k < THREADS; k++) {
        g_assert_cmpmem(asked[k].light, sizeof asked[k].light, asked[0].light,
                        sizeof asked[0].light);
        g_assert_cmpmem(asked[k].pdf, sizeof asked[k].pdf, asked[0].pdf, sizeof asked[0].pdf);
    }
    mesorig_material_close(material);
}

/* Many at the same time, lengths, and what is no direction. */
TEST(arguments) {
    mesorig_material *material = open_codec("eigenmaps", "");
    const float uv[4][2] = {{0.1F, 0.2F}, {0.1F, 0.2F}, {0.1F, 0.2F}, {NAN, 0.2F}};
    const float view[4][3] = {{0, 0, 1}, {0, 0, 7}, {0, 0, -1}, {0, 0, 1}};
    const float two[4][2] = {{0.3F, 0.6F}, {0.3F, 0.6F}, {0.3F, 0.6F}, {0.3F, 0.6F}};
    const float footprint[4] = {0.0F, 0.0F, 0.0F, 3.0F};
    float light[4][3], pdf[4], again[4];
    g_assert_cmpint(
        mesorig_material_sample(material, 4, uv[0], view[0], footprint, two[0], light[0], pdf), ==,
        MESORIG_OK);
    g_assert_cmpfloat(pdf[0], >, 0.0F);
    g_assert_cmpfloat(pdf[1], ==, pdf[0]);
    g_assert_cmpmem(light[1], sizeof light[1], light[0], sizeof light[0]);
    g_assert_cmpfloat(pdf[2], ==, 0.0F);
    g_assert_cmpfloat(pdf[3], ==, 0.0F);
    for (int c = 0; c < 3; c++)
        light[1][c] = 3.0F * light[0][c];
    g_assert_cmpint(mesorig_material_pdf(material, 4, uv[0], view[0], light[0], footprint, again),
                    ==, MESORIG_OK);
    g_assert_cmpfloat_with_epsilon(again[0], pdf[0], 1e-4F * pdf[0]);
    g_assert_cmpfloat_with_epsilon(again[1], pdf[0], 1e-4F * pdf[0]);
    g_assert_cmpfloat(again[2], ==, 0.0F);
    g_assert_cmpfloat(again[3], ==, 0.0F);
    g_assert_cmpint(mesorig_material_sample(NULL, 1, uv[0], view[0], NULL, two[0], light[0], pdf),
                    ==, MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_sample(material, 1, uv[0], view[0], NULL, NULL, light[0], pdf),
                    ==, MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_pdf(material, 1, uv[0], NULL, light[0], NULL, pdf), ==,
                    MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_pdf(material, 0, NULL, NULL, NULL, NULL, NULL), ==,
                    MESORIG_OK);
    mesorig_material_close(material);
}

BEFORE_TESTS {
    static const char *const files[][2] = {
        {"eigenmaps", ""},
        {"lpca", "clusters=3 components=4"},
        {"lpca", "clusters=2 components=3 grid=8"},
        {"hsh", ""},
        {"ward", ""},
        {"lafortune", ""},
        {"ptm", ""},
        {"neural", ""},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(files); k++) {
        g_autofree char *path =
            g_strdup_printf("/material-sample/codec/%s-%d", files[k][0], (int)k);
        g_test_add_data_func(path, files[k], test_codec);
    }
}
