#include "base/data_error.h"
#include "codecs/lpca/lpca.h"
#include "lib/damage.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include "exr/exr.h"
#include "lib/lpca_fixture.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

static struct lpca *compute(const struct btf_matrix *btf, int k, int c) {
    const struct lpca_options options = {.n_clusters = k, .n_components = c};
    struct lpca *lpca = ok(lpca_compute(btf, &options, ERR));
    return lpca;
}

static double error_of(const struct btf_matrix *btf, int k, int c) {
    g_autoptr(Lpca) lpca = compute(btf, k, c);
    const double error = lpca->error;
    return error;
}

/* Written out: the formula of the header, texel by texel. */
static double residual(const struct lpca *lpca, const struct btf_matrix *btf) {
    const int d = lpca_fixture_row_length(btf), c = lpca->n_components;
    double rest = 0, all = 0;
    for (gsize x = 0; x < btf_layout_texels(&btf->layout); x++)
        for (int j = 0; j < d; j++) {
            const float *e = lpca->brdfs + lpca->clusters[x] * (c + 1) * d + j;
            double value = btf->values[x * d + j], sum = e[0];
            for (int i = 1; i <= c; i++)
                sum += (double)lpca->weights[x * c + i - 1] * e[i * d];
            rest += (value - sum) * (value - sum);
            all += value * value;
        }
    return all > 0 ? sqrt(rest / all) : 0;
}

static void assert_orthonormal(const struct lpca *lpca) {
    const int d = btf_layout_values(&lpca->layout), c = lpca->n_components;
    for (int k = 0; k < lpca->n_clusters; k++)
        for (int i = 1; i <= c; i++)
            for (int j = 1; j <= i; j++) {
                const float *a = lpca->brdfs + (k * (c + 1) + i) * d;
                const float *b = lpca->brdfs + (k * (c + 1) + j) * d;
                double product = 0;
                for (int l = 0; l < d; l++)
                    product += (double)a[l] * b[l];
                if (i != j || product > 0.5)
                    g_assert_cmpfloat_with_epsilon(product, i == j, 1e-4);
                else /* left out */
                    g_assert_cmpfloat(product, ==, 0);
            }
}

/* A mixture of planes of low rank is told apart, and nothing is left. */
TEST(mixture) {
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(16, 15, 4, 5, 4, 2, 0);
    g_autoptr(Lpca) lpca = compute(btf, 4, 2);
    g_assert_cmpint(lpca->n_clusters, ==, 4);
    g_assert_cmpfloat(lpca->error, <, 2e-5);
    g_assert_cmpfloat_with_epsilon(residual(lpca, btf), lpca->error, 1e-6);
    for (int i = 0; i < 16 * 15; i++)
        g_assert_cmpint(lpca->clusters[i], ==, lpca->clusters[i % 4]);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++)
            g_assert_cmpint(lpca->clusters[i], !=, lpca->clusters[j]);
    assert_orthonormal(lpca);
}

/* Of the matrix less its mean row, beyond the first c, relative to the whole. */
static double dense_error(const struct btf_matrix *btf, int c) {
    const int d = lpca_fixture_row_length(btf), n = btf_layout_texels(&btf->layout),
              rank = MIN(n, d);
    g_autofree double *a = g_new(double, n *d), *s = g_new(double, rank);
    g_autofree double *superb = g_new(double, rank);
    double rest = 0, all = 0;
    for (int j = 0; j < d; j++) {
        double mean = 0;
        for (int i = 0; i < n; i++)
            mean += (double)btf->values[i * d + j] / n;
        for (int i = 0; i < n; i++) {
            a[i * d + j] = btf->values[i * d + j] - mean;
            all += (double)btf->values[i * d + j] * btf->values[i * d + j];
        }
    }
    g_assert_cmpint(
        LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'N', 'N', n, d, a, d, s, NULL, n, NULL, d, superb), ==, 0);
    for (int i = c; i < rank; i++)
        rest += s[i] * s[i];
    return sqrt(rest / all);
}

TEST(dense) {
    struct btf_matrix *btf = lpca_fixture_mixture(10, 9, 4, 5, 1, 8, 0.05);
    for (int c = 1; c <= 8; c++) {
        const double truth = dense_error(btf, c), error = error_of(btf, 1, c);
        g_assert_cmpfloat_with_epsilon(error, truth, 1e-4 * truth);
    }
    btf_matrix_free(btf);
    /* More texels than are drawn, more values than dimensions that are kept. */
    btf = lpca_fixture_mixture(31, 30, 5, 10, 1, 12, 0.1);
    for (int c = 1; c <= 16; c *= 4) {
        const double truth = dense_error(btf, c), error = error_of(btf, 1, c);
        g_assert_cmpfloat(error, >=, truth * (1 - 1e-5));
        g_assert_cmpfloat(error, <, truth * 1.01);
    }
    btf_matrix_free(btf);
}

TEST(monotone) {
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(24, 24, 4, 6, 11, 6, 0.05);
    double row[3] = {G_MAXDOUBLE, G_MAXDOUBLE, G_MAXDOUBLE};
    for (int k = 1; k <= 16; k *= 2) {
        double before = G_MAXDOUBLE;
        for (int i = 0; i < 3; i++) {
            const double error = error_of(btf, k, 1 << (i + i / 2));
            g_assert_cmpfloat(error, <, before);
            g_assert_cmpfloat(error, <, row[i]);
            before = row[i] = error;
        }
    }
}

TEST(threads) {
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(30, 27, 5, 9, 6, 5, 0.05);
    struct lpca *first = NULL;
    for (int threads = 1; threads <= 4; threads++) {
        const struct lpca_options options = {6, 4, .work.n_threads = threads};
        struct lpca *lpca = lpca_compute(btf, &options, NULL);
        g_assert_nonnull(lpca);
        if (first) {
            lpca_fixture_assert_same(lpca, first);
            g_assert_true(lpca->error == first->error);
            lpca_free(lpca);
        } else {
            first = lpca;
        }
    }
    lpca_free(first);
}

TEST(target) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(20, 20, 4, 5, 2, 12, 0.02);
    struct lpca_options options = {.n_clusters = 2, .n_components = 16, .target = 0.1};
    g_autoptr(Lpca) lpca = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat(lpca->error, <=, 0.1);
    g_assert_cmpint(lpca->n_components, >, 1);
    g_autoptr(Lpca) fewer = lpca_truncated(lpca, lpca->n_components - 1);
    g_assert_cmpfloat(lpca_error(fewer, btf, 0), >, 0.1);
    g_assert_cmpfloat_with_epsilon(residual(fewer, btf), fewer->error, 1e-6);
    options.target = 1e-5;
    g_assert_null(lpca_compute(btf, &options, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "is not reached"));
}

TEST(edges) {
    struct btf_matrix *btf = btf_fixture_new("weave", 5, 4, 2, 3); /* black */
    struct lpca *lpca = compute(btf, 4, 2);
    g_assert_cmpint(lpca->n_clusters, ==, 1);
    g_assert_cmpfloat(lpca->error, ==, 0);
    lpca_free(lpca);
    for (int i = 0; i < 20 * 18; i++) /* constant */
        btf->values[i] = 0.5F + 0.01F * (float)(i % 18);
    lpca = compute(btf, 4, 2);
    g_assert_cmpint(lpca->n_clusters, ==, 1);
    g_assert_cmpfloat(residual(lpca, btf), <, 1e-6);
    lpca_free(lpca);
    btf_matrix_free(btf);

    btf = lpca_fixture_mixture(4, 3, 1, 2, 3, 2, 0.1); /* one view; as many clusters as texels */
    lpca = compute(btf, 12, 6);
    g_assert_cmpfloat(residual(lpca, btf), <, 1e-5);
    assert_orthonormal(lpca);
    lpca_free(lpca);
    btf_matrix_free(btf);

    btf = lpca_fixture_mixture(1, 1, 1, 1, 1, 1, 0); /* one value of each colour */
    g_assert_cmpfloat(error_of(btf, 1, 3), <, 1e-6);
    btf_matrix_free(btf);
}

TEST(refused) {
    static const struct lpca_options bad[] = {
        {0, 2},  {-1, 2}, {21, 2}, {G_MAXINT, 2}, {2, 0},
        {2, -3}, {2, 65}, {2, 19}, {2, 2, NAN},   {2, 2, -0.1},
    };
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancelled = g_cancellable_new();
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(5, 4, 2, 3, 2, 2, 0.1);
    for (guint i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_assert_null(lpca_compute(btf, &bad[i], &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_clear_error(&error);
    }
    const struct lpca_options options = {2, 2, .work.cancellable = cancelled};
    g_cancellable_cancel(cancelled);
    g_assert_null(lpca_compute(btf, &options, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_clear_error(&error);
    btf->values[7 * 18 + 9] = NAN; /* texel (2, 1), view 1 */
    g_assert_null(lpca_compute(btf, &bad[0], NULL));
    const struct lpca_options good = {2, 2};
    g_assert_null(lpca_compute(btf, &good, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "view 1 in the texel of column 2 and row 1"));
}

/* What rounding may do to a texel: half a step of each eigen-BRDF, and the bits of a half. */
static void assert_within_bound(const struct lpca *exact, const struct lpca *rounded) {
    const int d = btf_layout_values(&exact->layout), c = exact->n_components;
    g_autofree float *a = g_new(float, d), *b = g_new(float, d);
    for (gsize x = 0; x < btf_layout_texels(&exact->layout); x++) {
        const int table = exact->clusters[x] * (c + 1);
        lpca_reconstruct(exact, x, a);
        lpca_reconstruct(rounded, x, b);
        for (int j = 0; j < d; j++) {
            double bound = 1e-6 + fabsf(exact->brdfs[table * d + j]) / 2048;
            for (int i = 1; i <= c; i++) {
                const double weight = fabsf(exact->weights[x * c + i - 1]);
                const double value = fabsf(exact->brdfs[(table + i) * d + j]);
                const double step =
                    rounded->quantise >= LPCA_8BIT
                        ? rounded->scales[table + i] *
                              rounded->light_scales[(table + i) * exact->layout.lights.n +
                                                    j / 3 % exact->layout.lights.n] /
                              2
                        : value / 2048 + 1e-7;
                const double weight_step =
                    rounded->quantise == LPCA_8BIT_WEIGHTS
                        ? rounded->weight_scales[exact->clusters[x] * c + i - 1] / 2
                        : weight / 2048 + 1e-7;
                bound += weight * step + weight_step * (value + step);
            }
            g_assert_cmpfloat(fabsf(a[j] - b[j]), <=, bound * (1 + 1e-4));
        }
    }
}

TEST(quantised) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(17, 16, 4, 5, 3, 4, 0.05);
    g_autoptr(Lpca) exact = compute(btf, 3, 4);
    gint64 bytes = G_MAXINT64;
    for (int kind = LPCA_FLOAT; kind < LPCA_QUANTISE_KINDS; kind++) {
        g_autoptr(GError) error = NULL;
        struct lpca *rounded = lpca_truncated(exact, 4);
        lpca_quantise(rounded, (enum lpca_quantise)kind);
        assert_within_bound(exact, rounded);
        lpca_error(rounded, btf, 0);
        g_assert_cmpfloat_with_epsilon(residual(rounded, btf), rounded->error, 1e-6);
        g_assert_cmpfloat(rounded->error, <, exact->error * 1.05);
        g_assert_cmpint(lpca_bytes(rounded), <, bytes);
        bytes = lpca_bytes(rounded);
        g_assert_true(lpca_write(path, rounded, &error));
        struct lpca *back = ok(lpca_read(path, ERR));
        lpca_fixture_assert_same(back, rounded);
        g_assert_cmpint(back->quantise, ==, kind);
        g_assert_true(back->error == rounded->error);
        g_assert_cmpstr(back->name, ==, "weave");
        g_assert_cmpfloat(back->layout.texel_mm, ==, 0.5);
        g_assert_cmpfloat(back->layout.reference_mm, ==, 5);
        g_assert_cmpfloat(back->layout.views.theta_deg[3], ==, 3);
        g_assert_cmpfloat(back->layout.lights.phi_deg[4], ==, 16);
        lpca_free(back);
        lpca_free(rounded);
    }
}

/* Relative, under one light, of what rounding makes of a local PCA. */
static double rounding_under(const struct lpca *exact, const struct lpca *rounded, int light) {
    const int d = btf_layout_values(&exact->layout);
    g_autofree float *a = g_new(float, d), *b = g_new(float, d);
    double off = 0, all = 0;
    for (gsize x = 0; x < btf_layout_texels(&exact->layout); x++) {
        lpca_reconstruct(exact, x, a);
        lpca_reconstruct(rounded, x, b);
        for (int j = 0; j < d; j++) {
            off += j / 3 % (int)exact->layout.lights.n == light ? pow(a[j] - b[j], 2) : 0;
            all += j / 3 % (int)exact->layout.lights.n == light ? pow(a[j], 2) : 0;
        }
    }
    return sqrt(off / all);
}

/* What a light at grazing angles leaves is as well rounded, for its size, as what others do. */
TEST(dark_light) {
    enum { DARK = 2 };
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(17, 16, 4, 5, 3, 4, 0.05);
    for (int i = 0; i < 17 * 16 * 4 * 5 * 3; i++)
        if (i / 3 % 5 == DARK)
            btf->values[i] *= 0.03F;
    g_autoptr(Lpca) exact = compute(btf, 3, 4);
    for (int kind = LPCA_8BIT; kind <= LPCA_8BIT_WEIGHTS; kind++) {
        g_autoptr(Lpca) rounded = lpca_truncated(exact, 4);
        lpca_quantise(rounded, (enum lpca_quantise)kind);
        g_assert_cmpfloat(rounded->light_scales[5 + DARK], <, 0.06);
        g_assert_cmpfloat(rounding_under(exact, rounded, DARK), <,
                          2 * rounding_under(exact, rounded, 0));
    }
}

static void write_small(const char *path, enum lpca_quantise quantise) {
    g_autoptr(BtfMatrix) btf = lpca_fixture_mixture(6, 5, 2, 3, 2, 2, 0.05);
    g_autoptr(Lpca) lpca = compute(btf, 2, 2);
    g_autoptr(GError) error = NULL;
    lpca_quantise(lpca, quantise);
    g_assert_true(lpca_write(path, lpca, &error));
}

TEST(truncated_file) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    g_autoptr(GError) error = NULL;
    write_small(path, LPCA_8BIT);
    assert_cut_refused(lpca_read, path, 97);
    g_unlink(path);
    g_assert_null(lpca_read(path, &error));
    g_assert_nonnull(strstr(error->message, "lpca.exr"));
}

/* Valid EXR files that are not valid local PCAs: a part is gone, a value of a channel or an
 * attribute of the part is another. */
static const struct fault {
    const char *part, *channel;
    float value;
    const char *attribute, *text; /* text NULL: the number 0 */
} faults[] = {
    {.part = "clusters"},
    {.part = "weights"},
    {.part = "scales"},
    {.part = "means"},
    {.part = "E02"},
    {.part = "views"},
    {.part = "lights"},
    {"clusters", "K", 2},
    {"clusters", "K", -1},
    {"clusters", "K", 0.5F},
    {"clusters", "K", NAN},
    {"weights", "W02", NAN},
    {"E01", "G", NAN},
    {.part = "clusters", .attribute = "texel_mm"},
    {.part = "clusters", .attribute = "mesorig.quantise", .text = "4bit"},
    {.part = "clusters", .attribute = "mesorig.kind", .text = "eigenmaps"},
    {"light_scales", "S", 0},
};

TEST(hostile) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        const struct fault *fault = &faults[i];
        write_small(path, g_str_equal(fault->part, "light_scales") ? LPCA_8BIT : LPCA_HALF);
        struct exr_file *file = ok(exr_read(path, ERR));
        struct exr_part *part = exr_file_part(file, fault->part);
        if (fault->channel)
            exr_part_plane(part, fault->channel)[1] = fault->value;
        else if (fault->text)
            exr_set_string(part, fault->attribute, fault->text);
        else if (fault->attribute)
            exr_set_double(part, fault->attribute, 0);
        else
            g_assert_true(g_ptr_array_remove(file->parts, part));
        assert_file_refused(lpca_read, path, file);
    }
}
