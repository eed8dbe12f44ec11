/* Errors of codecs at directions that were left out. */
#include "base/data_error.h"
#include "codecs/codec/held_out.h"
#include "codecs/codecs.h"
#include "lib/btf_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/waves_fixture.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "metrics/ssim.h"

#include <math.h>
#include <string.h>

#define WIDTH  14
#define HEIGHT 12

static gboolean contains(const int *list, int n, int value) {
    for (int i = 0; i < n; i++)
        if (list[i] == value)
            return TRUE;
    return FALSE;
}

TEST(draw) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = waves_fixture_new(2, 2, 40, 30, 0, FALSE);
    struct held_out a, b, c;
    g_assert_true(ok(held_out_draw(&btf->layout, 8, 5, 1, &a, ERR)));
    g_assert_true(ok(held_out_draw(&btf->layout, 8, 5, 1, &b, ERR)));
    g_assert_true(ok(held_out_draw(&btf->layout, 8, 5, 2, &c, ERR)));
    g_assert_cmpmem(a.views, 8 * sizeof(int), b.views, 8 * sizeof(int));
    g_assert_cmpmem(a.lights, 5 * sizeof(int), b.lights, 5 * sizeof(int));
    g_assert_cmpint(memcmp(a.views, c.views, 8 * sizeof(int)), !=, 0);
    for (int i = 0; i < 8; i++) {
        g_assert_cmpint(a.views[i], >, i ? a.views[i - 1] : -1);
        g_assert_cmpint(a.views[i], <, 40);
    }
    held_out_clear(&a);
    held_out_clear(&b);
    held_out_clear(&c);
    g_assert_false(held_out_draw(&btf->layout, 0, 28, 1, &a, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_cmpstr(error->message, ==,
                    "28 of 30 lights cannot be left out, because at least 3 must be kept; "
                    "leave out fewer lights");
    g_assert_true(held_out_draw(&btf->layout, 0, 27, 1, &a, NULL));
    held_out_clear(&a);
}

TEST(rest) {
    g_autoptr(BtfMatrix) btf = waves_fixture_new(3, 2, 6, 5, 0.1, FALSE);
    int views[] = {0, 4}, lights[] = {3};
    const struct held_out held = {2, 1, views, lights};
    g_autoptr(BtfMatrix) rest = held_out_rest(btf, &held);
    g_assert_cmpuint(rest->layout.width, ==, 3);
    g_assert_cmpuint(rest->layout.views.n, ==, 4);
    g_assert_cmpuint(rest->layout.lights.n, ==, 4);
    int k = 0;
    for (int i = 0; i < 6 * 6 * 5; i++) {
        const int view = i / 5 % 6, light = i % 5;
        if (contains(views, 2, view) || contains(lights, 1, light))
            continue;
        g_assert_cmpmem(btf->values + 3 * i, 3 * sizeof(float), rest->values + 3 * k,
                        3 * sizeof(float));
        g_assert_cmpfloat(btf->layout.views.theta_deg[view], ==,
                          rest->layout.views.theta_deg[k / 4 % 4]);
        g_assert_cmpfloat(btf->layout.lights.phi_deg[light], ==,
                          rest->layout.lights.phi_deg[k % 4]);
        k++;
    }
    g_assert_cmpint(k, ==, 6 * 4 * 4);
}

/* A BTF in which all values are 0.2, except that those of one view, which is left out, are 0.5. */
static struct btf_matrix *one_view(int bright) {
    struct btf_matrix *btf =
        btf_fixture_of("one", WIDTH, HEIGHT, btf_fixture_two_rings(0), btf_fixture_two_rings(10));
    const int n = WIDTH * HEIGHT * (int)btf_layout_values(&btf->layout);
    for (int i = 0; i < n; i++)
        btf->values[i] = i / 36 % 12 == bright ? 0.5F : 0.2F;
    return btf;
}

/* What no codec has seen is told from what it has seen: each has an error of (0.5 − 0.2) / 0.5. */
TEST(not_seen) {
    g_autoptr(BtfMatrix) btf = one_view(7);
    int views[] = {7};
    const struct held_out held = {1, 0, views, NULL};
    g_autoptr(BtfMatrix) rest = held_out_rest(btf, &held);
    const double shown = 0.735357 - 0.484529; /* of 0.5 and 0.2 as sRGB */
    for (gsize i = 0; i < 3; i++) {
        static const struct work quiet;
        const struct codec *codec = i ? codecs[i - 1] : &material_btf_codec;
        struct codec_result result = {0};
        g_autofree gpointer options = g_malloc0(MAX(codec->options_size, 1));
        if (i) {
            options_defaults(codec->options, options);
            const struct codec_job job = {.btf = rest, .options = options, .work = &quiet};
            g_assert_true(ok(codec->encode(codec, &job, &result, ERR)));
        }
        g_autoptr(Material) model =
            material_borrow(codec->name, codec, i ? result.levels->pdata[0] : rest);
        struct comparison *c = ok(held_out_compare(btf, &held, model, NULL, ERR));
        g_test_message("%s: %g", codec->name, c->all.error);
        g_assert_cmpint(c->n_views, ==, 1);
        g_assert_cmpint(c->n_lights, ==, 12);
        g_assert_cmpint(c->n_pictures, ==, 12);
        g_assert_cmpfloat_with_epsilon(c->all.error, 0.6, 1e-3);
        g_assert_cmpfloat_with_epsilon(c->all.psnr_db, -20 * log10(shown), 0.02);
        comparison_free(c);
        g_clear_pointer(&result.levels, g_ptr_array_unref);
    }
}

/* Of noise the BTF itself predicts nothing, and a codec that keeps all of it does not either. */
TEST(noise) {
    g_autoptr(BtfMatrix) btf =
        btf_fixture_of("noise", WIDTH, HEIGHT, btf_fixture_two_rings(0), btf_fixture_two_rings(10));
    GRand *random = g_rand_new_with_seed(4);
    for (gsize i = 0; i < WIDTH * HEIGHT * btf_layout_values(&btf->layout); i++)
        btf->values[i] = (float)g_rand_double_range(random, 0.1, 0.7);
    g_rand_free(random);
    struct held_out held;
    g_assert_true(ok(held_out_draw(&btf->layout, 2, 2, 1, &held, ERR)));
    g_autoptr(BtfMatrix) rest = held_out_rest(btf, &held);
    g_autoptr(Material) model = material_borrow("rest", &material_btf_codec, rest);
    struct comparison *c = ok(held_out_compare(btf, &held, model, NULL, ERR));
    g_assert_cmpfloat(c->all.error, >, 0.4); /* σ / √(mean² + σ²) = 0.397 of the truth alone */
    g_assert_cmpfloat(c->all.error, <, 0.6);
    g_assert_cmpint(c->n_pictures, ==, 4);
    comparison_free(c);
    held_out_clear(&held);
}

/* The means of SSIM and FLIP are those of the pictures of all pairs. */
TEST(pictures) {
    struct btf_matrix *a = waves_fixture_new(WIDTH, HEIGHT, 2, 3, 0, FALSE);
    struct btf_matrix *b = waves_fixture_new(WIDTH, HEIGHT, 2, 3, 0.05, FALSE);
    double sum_ssim = 0, sum_flip = 0, sum_square = 0;
    for (int pair = 0; pair < 6; pair++) {
        float one[WIDTH * HEIGHT * 3], other[WIDTH * HEIGHT * 3];
        for (int i = 0; i < WIDTH * HEIGHT * 3; i++) {
            one[i] = a->values[i / 3 * 18 + pair * 3 + i % 3];
            other[i] = b->values[i / 3 * 18 + pair * 3 + i % 3];
        }
        sum_ssim += ssim(one, other, WIDTH, HEIGHT);
        sum_flip += flip_ldr(one, other, WIDTH, HEIGHT, FLIP_PIXELS_PER_DEGREE, NULL);
        sum_square += psnr_mean_square(one, other, WIDTH, HEIGHT);
    }
    g_autoptr(Material) of_a = material_new("a", &material_btf_codec, a),
                        of_b = material_new("b", &material_btf_codec, b);
    struct comparison *c = ok(compare_materials(of_a, of_b, NULL, ERR));
    g_assert_cmpint(c->n_pictures, ==, 6);
    g_assert_cmpfloat_with_epsilon(c->ssim, sum_ssim / 6, 1e-9);
    g_assert_cmpfloat_with_epsilon(c->flip, sum_flip / 6, 1e-9);
    g_assert_cmpfloat_with_epsilon(c->all.psnr_db, psnr_decibels(sum_square / 6), 1e-9);
    g_assert_cmpfloat(c->ssim, <, 0.99);
    comparison_free(c);
    double ns = 0;
    g_assert_true(ok(compare_evaluation_ns(of_a, &ns, ERR)));
    g_assert_cmpfloat(ns, >, 1);
}

/* With nothing left out the comparison is that at the measured directions. */
TEST(nothing_left_out) {
    g_autoptr(BtfMatrix) btf = one_view(7);
    const struct held_out none = {0};
    double error = -1;
    for (gsize i = 0; i < WIDTH * HEIGHT * btf_layout_values(&btf->layout); i++)
        btf->values[i] *= 1 + 0.2F * (float)(i % 5);
    g_assert_true(ok(held_out_error(btf, &none, &material_btf_codec, btf, NULL, &error, ERR)));
    g_assert_cmpfloat_with_epsilon(error, 0, 1e-6);
}
