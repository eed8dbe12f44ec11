#include "base/data_error.h"
#include "btf/direction_grid.h"
#include "codecs/lpca/lpca_resample.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include "codecs/lpca/lpca_choose.h"
#include "codecs/lpca/lpca_levels.h"
#include "exr/exr.h"
#include "lib/btf_fixture.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static double uniform(GRand *random, double low, double high) {
    return g_rand_double_range(random, low, high);
}

/* There and back; equal areas of the square are equal solid angles; the formula of Schneider 2004
 * §6.1. */
TEST(map) {
    GRand *random = g_rand_new_with_seed(2);
    int counts[8] = {0};
    for (int i = 0; i < 8000; i++) {
        const double s = uniform(random, 0, 1), t = uniform(random, 0, 1);
        double s2, t2;
        float d[3];
        direction_grid_direction(s, t, d);
        g_assert_cmpfloat_with_epsilon(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1, 1e-5);
        direction_grid_square(d, &s2, &t2);
        g_assert_cmpfloat_with_epsilon(s2, s, 1e-3);
        g_assert_cmpfloat_with_epsilon(t2, t, 1e-3);
        counts[MIN((int)(4 * d[2]), 3) + (d[0] > d[1] ? 4 : 0)]++;
    }
    for (int i = 0; i < 8; i++) /* of binomially 1000 ± 30 */
        g_assert_cmpint(ABS(counts[i] - 1000), <, 150);
    g_rand_free(random);
    float d[3];
    direction_grid_direction(0.75, 0.625, d); /* a = ½, b = ¼: ρ = ½, φ = π/8 */
    g_assert_cmpfloat_with_epsilon(d[0], 0.5 * sqrt(1.75) * cos(G_PI / 8), 1e-6);
    g_assert_cmpfloat_with_epsilon(d[1], 0.5 * sqrt(1.75) * sin(G_PI / 8), 1e-6);
    g_assert_cmpfloat_with_epsilon(d[2], 0.75, 1e-6);
    double s, t;
    const float below[3] = {0, -0.8F, -0.6F};
    direction_grid_square(below, &s, &t);
    g_assert_cmpfloat_with_epsilon(s, 0.5, 1e-6);
    g_assert_cmpfloat_with_epsilon(t, 0, 1e-6);
}

static struct direction_list rings(void) {
    struct direction_list ret = direction_list_new(60);
    for (int i = 0; i < 60; i++) {
        ret.theta_deg[i] = 15 + 15 * (float)(i / 12);
        ret.phi_deg[i] = 30 * (float)(i % 12);
    }
    return ret;
}

/* A smooth lobe, in double precision. */
static double smooth(const float d[3]) {
    return 0.3 + 0.5 * d[2] + 0.4 * exp(-4 * ((d[0] - 0.4) * (d[0] - 0.4) + d[1] * d[1]));
}

static void direction_of(double theta_deg, double phi_deg, float ret[3]) {
    ret[0] = (float)(sin(theta_deg * G_PI / 180) * cos(phi_deg * G_PI / 180));
    ret[1] = (float)(sin(theta_deg * G_PI / 180) * sin(phi_deg * G_PI / 180));
    ret[2] = (float)cos(theta_deg * G_PI / 180);
}

static double at(const double *samples, int n_grid, const float d[3]) {
    int index[4];
    float weight[4];
    double sum = 0, all = 0;
    direction_grid_weights(n_grid, d, index, weight);
    for (int k = 0; k < 4; k++) {
        g_assert_cmpint(index[k], >=, 0);
        g_assert_cmpint(index[k], <, n_grid * n_grid);
        g_assert_cmpfloat(weight[k], >=, 0);
        all += weight[k];
        sum += weight[k] * samples[index[k]];
    }
    g_assert_cmpfloat_with_epsilon(all, 1, 1e-5);
    return sum;
}

/* A smooth function is kept, at and between what was measured, the better the finer the grid; a
 * constant is one everywhere; lights fade to 0 at the horizon. */
TEST(operator) {
    struct direction_list list = rings();
    const float *theta = list.theta_deg, *phi = list.phi_deg;
    const int n = (int)list.n;
    double before = 1;
    for (int n_grid = 8; n_grid <= 16; n_grid += 4) {
        g_autofree float *views = direction_grid_operator(&list, n_grid, FALSE, NULL);
        g_autofree float *lights = direction_grid_operator(&list, n_grid, TRUE, NULL);
        g_autofree double *samples = g_new0(double, n_grid *n_grid);
        g_autofree double *ones = g_new0(double, n_grid *n_grid);
        g_autofree double *faded = g_new0(double, n_grid *n_grid);
        float d[3];
        for (int i = 0; i < n_grid * n_grid; i++)
            for (int j = 0; j < n; j++) {
                direction_of(theta[j], phi[j], d);
                samples[i] += views[i * n + j] * smooth(d);
                ones[i] += views[i * n + j];
                faded[i] += lights[i * n + j];
            }
        double worst = 0, worst_measured = 0;
        for (int i = 0; i < n; i++) {
            direction_of(theta[i], phi[i], d);
            worst_measured = MAX(worst_measured, fabs(at(samples, n_grid, d) - smooth(d)));
        }
        for (double t = 16; t < 74; t += 3)
            for (double p = 0; p < 360; p += 7) {
                direction_of(t, p, d);
                worst = MAX(worst, fabs(at(samples, n_grid, d) - smooth(d)));
                g_assert_cmpfloat_with_epsilon(at(ones, n_grid, d), 1, 1e-3);
                if (n_grid > 8 && t < 66) /* a coarse grid cannot bend that fast */
                    g_assert_cmpfloat_with_epsilon(at(faded, n_grid, d), 1, 0.15);
            }
        direction_of(90, 40, d);
        g_assert_cmpfloat_with_epsilon(at(ones, n_grid, d), 1, 1e-3);
        g_assert_cmpfloat(fabs(at(faded, n_grid, d)), <, n_grid == 8 ? 0.3 : 0.25);
        g_test_message("grid %d: %.4f between, %.4f at", n_grid, worst, worst_measured);
        g_assert_cmpfloat(worst, <, n_grid == 8 ? 0.1 : 0.05);
        g_assert_cmpfloat(worst_measured, <, before);
        before = worst_measured;
    }
    direction_list_clear(&list);
}

TEST(refused) {
    float theta[] = {10, 100}, phi[] = {0, 50}, nan[] = {NAN, 0};
    const struct {
        struct direction_list list;
        int n_grid;
    } cases[] = {
        {{0, theta, phi}, 12}, {{1, theta, phi}, 3},  {{1, theta, phi}, 1000},
        {{2, theta, phi}, 12}, {{1, theta, nan}, 12},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(direction_grid_operator(&cases[i].list, cases[i].n_grid, FALSE, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    }
    const struct direction_list view = {1, theta, phi}; /* one view is all */
    g_autofree float *one = direction_grid_operator(&view, 8, FALSE, NULL);
    for (int i = 0; i < 64; i++)
        g_assert_cmpfloat_with_epsilon(one[i], 1, 0.05);
}

/* Lambertian bumps: a normal a texel. */
static struct btf_matrix *new_btf(int size) {
    struct btf_matrix *btf = btf_fixture_of("bumps", size, size, rings(), rings());
    btf->layout.texel_mm = 1;
    for (int i = 0; i < size * size * 60 * 60; i++) {
        const int texel = i / 3600, light = i % 60;
        const double a = 0.4 * sin(texel % size), b = 0.4 * cos(2.0 * texel / size);
        float l[3];
        direction_of(btf->layout.lights.theta_deg[light], btf->layout.lights.phi_deg[light], l);
        const double nl = (a * l[0] + b * l[1] + l[2]) / sqrt(1 + a * a + b * b);
        const double y = 0.7 * MAX(nl, 0) * (1 + 0.2 * sin(0.1 * (i / 60 % 60)));
        for (int c = 0; c < 3; c++)
            btf->values[3 * i + c] = (float)(y * (1 - 0.2 * c));
    }
    return btf;
}

/* The error at the measured directions is known before and after, on disk and when rounded. */
TEST(lpca) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf(6);
    const struct lpca_options options = {.n_clusters = 2, .n_components = 4};
    struct lpca *lpca = lpca_compute(btf, &options, &error);
    struct lpca *grid = ok(lpca_resample(lpca, 10, ERR));
    g_assert_cmpint(grid->n_grid, ==, 10);
    g_assert_cmpint(grid->layout.views.n, ==, 100);
    const double found = lpca_resample_error(grid, btf, 0);
    g_assert_cmpfloat(found, <, lpca->error + 0.04);
    lpca_quantise(grid, LPCA_8BIT);
    const double rounded = lpca_resample_error(grid, btf, 0);
    g_assert_cmpfloat(rounded, <, found + 0.01);
    g_assert_true(lpca_write(path, grid, &error));
    struct lpca *back = ok(lpca_read(path, ERR));
    g_assert_cmpint(back->n_grid, ==, 10);
    g_assert_true(back->error == rounded);
    g_assert_cmpfloat_with_epsilon(lpca_resample_error(back, btf, 0), rounded, 1e-6);
    g_assert_null(lpca_resample(lpca, 100, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    lpca_free(back);
    lpca_free(grid);
    lpca_free(lpca);
    btf_matrix_free(btf);
}

/* What is asked for is kept, and not beaten by any choice near it. */
TEST(choose) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf(8);
    const struct lpca_options options = {0};
    struct lpca_target wanted = {.bytes = 300000, .n_components = 8, .quantise = LPCA_8BIT};
    struct lpca *best = ok(lpca_choose(btf, &options, &wanted, ERR));
    for (int k = 1; k <= 4; k *= 2) {
        const struct lpca_options other = {.n_clusters = k, .n_components = 2};
        struct lpca *lpca = lpca_compute(btf, &other, NULL);
        struct lpca like = *lpca;
        like.quantise = LPCA_8BIT;
        if (lpca_bytes(&like) <= wanted.bytes)
            g_assert_cmpfloat(best->error, <=, lpca->error * 1.0001);
        lpca_free(lpca);
    }
    lpca_quantise(best, LPCA_8BIT);
    g_assert_cmpint(lpca_bytes(best), <=, wanted.bytes);
    lpca_free(best);
    wanted = (struct lpca_target){.error = 0.05, .n_components = 8, .quantise = LPCA_HALF};
    best = ok(lpca_choose(btf, &options, &wanted, ERR));
    g_assert_cmpfloat(best->error, <=, 0.05);
    lpca_free(best);
    wanted.bytes = 1000;
    g_assert_null(lpca_choose(btf, &options, &wanted, &error));
    g_assert_nonnull(strstr(error->message, "is too small"));
    g_clear_error(&error);
    for (gsize i = 0; i < btf_layout_texels(&btf->layout); i++) /* all texels alike */
        memcpy(btf->values + i * 3 * (gsize)(btf->layout.views.n * btf->layout.lights.n),
               btf->values,
               sizeof(float) * 3 * (gsize)(btf->layout.views.n * btf->layout.lights.n));
    wanted = (struct lpca_target){.bytes = 300000, .n_components = 8};
    best = ok(lpca_choose(btf, &options, &wanted, ERR));
    g_assert_cmpint(best->n_components, ==, 1);
    lpca_free(best);
    btf_matrix_free(btf);
    btf = new_btf(8);
    wanted = (struct lpca_target){.error = 1e-7, .bytes = 100000, .n_components = 8};
    g_assert_null(lpca_choose(btf, &options, &wanted, &error));
    g_assert_nonnull(strstr(error->message, "is not reached"));
    btf_matrix_free(btf);
}

/* Levels are means over areas, also of odd sizes, and come back from one file each as it was. */
TEST(levels) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct lpca *levels[3], *found[LPCA_MAX_LEVELS];
    struct btf_matrix *btf = new_btf(5), *half = btf_matrix_halved(btf);
    const int row = 60 * 60 * 3;
    g_assert_cmpint(half->layout.width, ==, 2);
    g_assert_cmpfloat(half->layout.texel_mm, ==, 2.5);
    for (int i = 0; i < row; i += 97) { /* 2.5 × 2.5 texels: two whole, one by half, each way */
        static const double share[] = {0.4, 0.4, 0.2};
        double mean = 0;
        for (int y = 0; y < 3; y++)
            for (int x = 0; x < 3; x++)
                mean +=
                    share[x] * share[y] * btf->values[(gsize)(y * 5 + x) * (gsize)row + (gsize)i];
        g_assert_cmpfloat_with_epsilon(half->values[i], mean, 1e-5);
    }
    struct btf_matrix *one = btf_matrix_halved(half);
    g_assert_cmpint(btf_layout_texels(&one->layout), ==, 1);
    g_assert_null(btf_matrix_halved(one));
    const struct btf_matrix *all[] = {btf, half, one};
    for (int i = 0; i < 3; i++) {
        const struct lpca_options options = {.n_clusters = MIN(2, all[i]->layout.width),
                                             .n_components = 2};
        levels[i] = ok(lpca_compute(all[i], &options, ERR));
        lpca_quantise(levels[i], LPCA_HALF);
        lpca_error(levels[i], all[i], 0);
    }
    g_assert_true(lpca_write_levels(path, levels, 3, &error));
    g_assert_cmpint(lpca_read_levels(path, found, &error), ==, 3);
    for (int i = 0; i < 3; i++) {
        struct lpca *back = i ? found[i] : lpca_read(path, &error);
        g_assert_no_error(error);
        g_assert_cmpint(back->layout.width, ==, all[i]->layout.width);
        g_assert_cmpfloat(back->layout.texel_mm, ==, all[i]->layout.texel_mm);
        g_assert_true(back->error == levels[i]->error);
        g_assert_cmpfloat_with_epsilon(lpca_error(back, all[i], 0), levels[i]->error, 1e-6);
        lpca_free(back);
        lpca_free(levels[i]);
    }
    lpca_free(found[0]);
    btf_matrix_free(one);
    btf_matrix_free(half);
    btf_matrix_free(btf);
}
