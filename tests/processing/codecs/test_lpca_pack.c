/* Packed local PCAs: their size and errors, what cannot be packed, and how they are drawn. */
#include "base/data_error.h"
#include "codecs/lpca/lpca_choose.h"
#include "codecs/lpca/lpca_pack_private.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/waves_fixture.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define SIDE_X 23
#define SIDE_Y 17
#define VIEWS  9
#define LIGHTS 11
#define VALUES (VIEWS * LIGHTS * 3)

static struct btf_matrix *waves(double noise, gboolean constant) {
    return waves_fixture_new(SIDE_X, SIDE_Y, VIEWS, LIGHTS, noise, constant);
}

/* Written out: what a PCA of one cluster is off by. */
static double error_of(const struct lpca *lpca, const struct btf_matrix *btf) {
    double rest = 0, all = 0;
    for (int x = 0; x < SIDE_X * SIDE_Y; x++)
        for (int j = 0; j < VALUES; j++) {
            const float *e =
                lpca->brdfs + (gsize)lpca->clusters[x] * (gsize)(lpca->n_components + 1) * VALUES;
            double value = btf->values[x * VALUES + j], sum = (double)e[j];
            for (int i = 0; i < lpca->n_components; i++)
                sum += (double)lpca->weights[x * lpca->n_components + i] *
                       (double)e[(i + 1) * VALUES + j];
            rest += (value - sum) * (value - sum);
            all += value * value;
        }
    return sqrt(rest / all);
}

static struct lpca *compute(const struct btf_matrix *btf, int k, int c) {
    const struct lpca_options options = {k, c, .to_pack = TRUE};
    struct lpca *lpca = ok(lpca_compute(btf, &options, ERR));
    return lpca;
}

static void assert_same(const struct lpca *a, const struct lpca *b) {
    const gsize tables = (gsize)a->n_clusters * (gsize)(a->n_components + 1);
    g_assert_cmpint(a->n_components, ==, b->n_components);
    g_assert_cmpint(a->n_clusters, ==, b->n_clusters);
    g_assert_cmpmem(a->clusters, SIDE_X * SIDE_Y * sizeof(int), b->clusters,
                    SIDE_X * SIDE_Y * sizeof(int));
    for (gsize i = 0; i < tables * VALUES; i++)
        g_assert_cmpfloat_with_epsilon(a->brdfs[i], b->brdfs[i], 2e-4 * a->packed->step);
    for (gsize i = 0; i < SIDE_X * SIDE_Y * (gsize)a->n_components; i++)
        g_assert_cmpfloat_with_epsilon(a->weights[i], b->weights[i], 2e-4 * a->packed->step);
}

static gint64 file_size(const char *path) {
    GStatBuf status;
    g_assert_cmpint(g_stat(path, &status), ==, 0);
    return status.st_size;
}

/* Whole numbers of every size, back as they were; what is damaged or does not fit is refused. */
TEST(numbers) {
    static const gint32 values[] = {0,   0,    0,      1,       -1,         127,         -127, 128,
                                    254, -128, 100000, -100000, G_MAXINT32, -G_MAXINT32, 0,    7};
    const gsize n = G_N_ELEMENTS(values);
    g_autoptr(GByteArray) bytes = lpca_varint_encode(values, n);
    g_autofree gint32 *back = lpca_varint_decode(bytes->data, bytes->len, n);
    g_assert_cmpmem(back, n * sizeof *back, values, sizeof values);
    g_assert_null(lpca_varint_decode(bytes->data, bytes->len, n + 1));
    g_assert_null(lpca_varint_decode(bytes->data, bytes->len, n - 1));
    g_assert_null(lpca_varint_decode(bytes->data, bytes->len, (gsize)1 << 40));
    for (guint i = 0; i < bytes->len; i++) {
        g_assert_null(lpca_varint_decode(bytes->data, i, n));
        bytes->data[i] ^= 0x10;
        g_autofree gint32 *damaged = lpca_varint_decode(bytes->data, bytes->len, n);
        g_assert_true(!damaged || memcmp(damaged, values, sizeof values) == 0);
        bytes->data[i] ^= 0x10;
    }
}

/* Cosines keep lengths, and are those of the textbook: of a cosine one number is left. */
TEST(cosines) {
    for (int n = 1; n <= 12; n += n < 4 ? 1 : 4) {
        g_autofree float *turn = lpca_cosines(n);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                double product = 0;
                for (int k = 0; k < n; k++)
                    product += (double)turn[i * n + k] * (double)turn[j * n + k];
                g_assert_cmpfloat_with_epsilon(product, i == j, 1e-6);
            }
        for (int k = 0; n > 2 && k < n; k++)
            g_assert_cmpfloat_with_epsilon(turn[2 * n + k] * sqrt(n / 2.0),
                                           cos(2 * G_PI * (k + 0.5) / n), 1e-6);
    }
}

/* A fine step gives back what was packed; a coarser one is smaller and worse, by about as much as
 * a uniform error of its width makes. */
TEST(steps) {
    g_autoptr(BtfMatrix) btf = waves(0.002, FALSE);
    for (int k = 1; k <= 4; k += 3) {
        g_autoptr(Lpca) exact = compute(btf, k, 12);
        struct lpca_packer *packer = lpca_packer_new(exact, 0);
        const double left = error_of(exact, btf);
        double before = 0;
        gint64 larger = G_MAXINT64;
        for (double step = 1e-4; step < 0.5; step *= 4) {
            g_autoptr(Lpca) lpca = lpca_packer_round(packer, step);
            const double error = error_of(lpca, btf);
            g_assert_cmpint(lpca->quantise, ==, LPCA_PACKED);
            g_assert_cmpint(lpca_packed_bytes(lpca, NULL), <, larger);
            g_assert_cmpfloat(error, >=, before * (1 - 1e-6));
            g_assert_cmpfloat_with_epsilon(lpca_error(lpca, btf, 0), error, 1e-6);
            if (step < 1e-3)
                g_assert_cmpfloat_with_epsilon(error, left, 0.01 * left);
            larger = lpca_packed_bytes(lpca, NULL);
            before = error;
        }
        lpca_packer_free(packer);
    }
}

/* What is wished is had, on disk, and read back. */
TEST(wishes) {
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "packed.exr", NULL);
    g_autoptr(BtfMatrix) btf = waves(0.002, FALSE);
    const struct lpca_options options = {0};
    gint64 smallest = G_MAXINT64;
    for (double target = 0.01; target < 0.05; target *= 2) {
        const struct lpca_target wanted = {.error = target};
        g_autoptr(Lpca) lpca = lpca_pack(btf, &options, &wanted, &error);
        g_assert_no_error(error);
        g_assert_cmpfloat(error_of(lpca, btf), <=, target * (1 + 1e-5));
        g_assert_cmpfloat(error_of(lpca, btf), >, target * 0.9);
        g_assert_true(lpca_write(path, lpca, &error));
        struct lpca *back = ok(lpca_read(path, ERR));
        assert_same(lpca, back);
        g_assert_cmpfloat(back->error, ==, lpca->error);
        g_assert_true(lpca_write(path, back, &error)); /* and again */
        lpca_free(back);
        back = lpca_read(path, &error);
        assert_same(lpca, back);
        g_assert_cmpint(file_size(path), <, smallest);
        smallest = file_size(path);
        lpca_free(back);
    }
    const struct lpca_target small = {.bytes = 9000};
    g_autoptr(Lpca) lpca = lpca_pack(btf, &options, &small, &error);
    g_assert_no_error(error);
    g_assert_true(lpca_write(path, lpca, &error));
    g_assert_cmpint(file_size(path), <=, 9000);
    g_assert_cmpint(file_size(path), >, 8500);
    g_assert_cmpint(file_size(path), ==, lpca_packed_bytes(lpca, NULL));
}

TEST(refused) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancelled = g_cancellable_new();
    g_autoptr(BtfMatrix) btf = waves(0.05, FALSE);
    struct lpca_options options = {0};
    struct lpca_target wanted = {.error = 0.01, .n_components = 8};
    g_assert_null(lpca_pack(btf, &options, &wanted, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "8 components give "));
    g_clear_error(&error);
    wanted = (struct lpca_target){.bytes = 20};
    g_assert_null(lpca_pack(btf, &options, &wanted, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "too small"));
    g_clear_error(&error);
    options.work.cancellable = cancelled;
    g_cancellable_cancel(cancelled);
    g_assert_null(lpca_pack(btf, &options, &wanted, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

/* A constant material and a black one have nothing that counts but a mean, if that. */
TEST(edges) {
    const struct lpca_options options = {0};
    const struct lpca_target wanted = {.error = 0.02};
    g_autoptr(BtfMatrix) btf = waves(0, TRUE);
    struct lpca *lpca = ok(lpca_pack(btf, &options, &wanted, ERR));
    g_assert_cmpint(lpca->n_components, ==, 1);
    g_assert_cmpfloat(error_of(lpca, btf), <=, 0.02);
    lpca_free(lpca);
    memset(btf->values, 0, sizeof(float) * SIDE_X * SIDE_Y * VALUES);
    lpca = ok(lpca_pack(btf, &options, &wanted, ERR));
    g_assert_cmpfloat(lpca->error, ==, 0);
    lpca_free(lpca);
}

/* Damage of any byte is an error or harmless, never more. */
TEST(damage) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = g_dir_make_tmp("pack-XXXXXX", &error), *bytes = NULL;
    g_autofree char *path = g_build_filename(folder, "packed.exr", NULL);
    g_autoptr(BtfMatrix) btf = waves(0.01, FALSE);
    const struct lpca_options options = {0};
    const struct lpca_target wanted = {.bytes = 6500};
    g_autoptr(Lpca) lpca = lpca_pack(btf, &options, &wanted, &error);
    gsize size;
    int refused = 0;
    g_assert_true(lpca_write(path, lpca, &error));
    g_assert_true(g_file_get_contents(path, &bytes, &size, &error));
    for (gsize i = 0; i < size; i += 37) {
        bytes[i] ^= 0x55;
        g_assert_true(g_file_set_contents(path, bytes, (gssize)size, &error));
        g_autoptr(Lpca) back = lpca_read(path, NULL);
        refused += back == NULL;
        bytes[i] ^= 0x55;
        if (i % 5 == 0) {
            g_assert_true(g_file_set_contents(path, bytes, (gssize)i, &error));
            g_assert_null(lpca_read(path, NULL));
        }
    }
    g_assert_cmpint(refused, >, (int)(size / 37) / 3);
    remove_tree(folder);
}

/* Drawn, it has few components in many clusters, and is as good as a local PCA of that size. */
TEST(regroup) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = waves(0.002, FALSE);
    const struct lpca_options options = {8, 4};
    const struct lpca_target wanted = {.error = 0.01};
    g_autoptr(Lpca) packed = lpca_pack(btf, &(struct lpca_options){0}, &wanted, &error);
    g_autoptr(Lpca) drawn = lpca_regroup(packed, &options, &error);
    g_autoptr(Lpca) direct = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    g_assert_cmpint(drawn->quantise, ==, LPCA_FLOAT);
    g_assert_cmpint(drawn->n_clusters, ==, 8);
    g_assert_cmpint(drawn->n_components, ==, 4);
    g_assert_cmpfloat(error_of(drawn, btf), <, hypot(direct->error, 0.01) * 1.1);
    g_assert_cmpfloat(error_of(drawn, btf), >, packed->error);
}

/* A packed file has one cluster, which those who draw it rely on. */
TEST(clusters) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.lpca", NULL);
    g_autoptr(BtfMatrix) btf = waves(0.002, FALSE);
    g_autoptr(Lpca) exact = compute(btf, 4, 4);
    g_autoptr(GError) error = NULL;
    struct lpca_packer *packer = lpca_packer_new(exact, 0);
    g_autoptr(Lpca) packed = lpca_packer_round(packer, 1e-3);
    lpca_packer_free(packer);
    ok(lpca_write(path, packed, ERR));
    g_autoptr(Lpca) read = lpca_read(path, &error);
    g_assert_null(read);
    g_assert_nonnull(strstr(error->message, "has several clusters"));
}
