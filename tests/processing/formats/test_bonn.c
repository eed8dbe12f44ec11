/* Bonn's .btf files, against a reader and writer in Python that share nothing with ours. */
#include "exr/exr_half.h"
#include "formats/bonn/bonn.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* What bonn_peer.py writes of each. */
#define WIDTH  5
#define HEIGHT 3
#define VIEWS  3
#define LIGHTS 4
#define TEXELS (WIDTH * HEIGHT)
#define VALUES (VIEWS * LIGHTS * TEXELS * 3)

static const char *const kinds[] = {
    "bdi",           "bdi-sparse", "bdi-short",      "bdi-short-sparse",
    "fmf",           "fmf-images", "fmf-log",        "fmf-float",
    "fmf-double",    "fmf-old",    "fmf-old-images", "dfmf-0",
    "dfmf-0-images", "dfmf-1",     "dfmf-3",         "dfmf-4",
    "dfmf-9",        "dfmf-10",    "dfmf-11",        "dfmf-11-images",
    "dfmf-12",
};

static void peer(const char *verb, const char *kind, const char *file, const char *values) {
    const char *argv[] = {"python3", SOURCE_DIR "/tests/bonn_peer.py", verb, kind, file, values,
                          NULL};
    const char *reading[] = {argv[0], argv[1], verb, file, values, NULL};
    g_free(process_text(0, kind ? argv : reading));
}

static BonnFile *open_good(const char *path) {
    BonnFile *file = ok(bonn_open(path, ERR));
    return file;
}

static float *values_of(const char *path, gsize n) {
    char *bytes = NULL;
    gsize length = 0;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_assert_cmpuint(length, ==, n * sizeof(float));
    return (float *)bytes;
}

static void assert_values(const BonnFile *file, const float *wanted, double tolerance, int holes) {
    const struct bonn_header *header = bonn_header(file);
    const gsize n = (gsize)header->n_lights * (gsize)header->width * (gsize)header->height * 3;
    g_autofree float *rgb = g_new(float, n);
    g_autofree int *missing = g_new(int, header->n_lights);
    for (int view = 0; view < header->n_views; view++) {
        g_assert_true(bonn_read_view(file, view, rgb, missing, NULL));
        for (gsize i = 0; i < n; i++)
            g_assert_cmpfloat_with_epsilon((double)rgb[i], (double)wanted[(gsize)view * n + i],
                                           tolerance);
        for (int light = 0; light < header->n_lights; light++)
            g_assert_cmpint(missing[light], ==, holes);
    }
    if (header->kind != BONN_BDI && header->kind != BONN_BDI_SPARSE)
        return;
    /* Several views together, picture by picture. */
    const gsize picture = n / (gsize)header->n_lights;
    for (int first = 0; first < header->n_views; first++) {
        const int views_left = header->n_views - first;
        g_autoptr(BonnViews) views = ok(bonn_views_read(file, first, views_left, 2, ERR));
        for (int i = 0; i < views_left * header->n_lights; i++) {
            const int view = first + i / header->n_lights, light = i % header->n_lights;
            g_assert_cmpint(bonn_views_picture(views, view, light, rgb), ==, holes);
            g_assert_cmpmem(rgb, picture * sizeof *rgb,
                            wanted + (gsize)view * n + (gsize)light * picture,
                            picture * sizeof *rgb);
        }
    }
}

TEST(read) {
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        g_autofree char *path = in_folder(kinds[i]);
        g_autofree char *values = g_strconcat(path, ".values", NULL);
        peer("write", kinds[i], path, values);
        g_autofree float *wanted = values_of(values, VALUES);
        g_autoptr(BonnFile) file = open_good(path);
        const gboolean bdi = g_str_has_prefix(kinds[i], "bdi");
        assert_values(file, wanted, bdi ? 1e-9 : 2e-6, strstr(kinds[i], "sparse") ? 3 : 0);
        const struct bonn_header *header = bonn_header(file);
        g_assert_cmpstr(header->sensor, ==, "a sensor");
        g_assert_cmpstr(header->xml, ==, "<measured/>");
        g_assert_cmpfloat(header->texels_a_mm, ==, 2.5);
        g_assert_cmpint(header->n_rotations, ==, bdi ? 1 : 0);
        g_assert_true(header->cosine);
        g_assert_cmpfloat_with_epsilon((double)header->view_phi_deg[2], 4 * 180 / G_PI, 1e-4);
        g_assert_cmpfloat_with_epsilon((double)header->light_theta_deg[3], 1.2 * 180 / G_PI, 1e-4);
    }
}

static void angles(float **ret, int n, double step) {
    *ret = g_new(float, n);
    for (int i = 0; i < n; i++)
        (*ret)[i] = (float)(step * i);
}

/* Of another shape than the peer's. */
static struct bonn_header some_header(enum bonn_kind kind) {
    struct bonn_header header = {.kind = kind,
                                 .texels_a_mm = 4,
                                 .rgb_scale = {1, 1, 1},
                                 .cosine = TRUE,
                                 .width = 7,
                                 .height = 9,
                                 .n_views = 2,
                                 .n_lights = 5,
                                 .setup = g_strdup("Prüfstand"),
                                 .xml = g_strdup("<?xml?>")};
    angles(&header.view_theta_deg, 2, 30);
    angles(&header.view_phi_deg, 2, 100);
    angles(&header.light_theta_deg, 5, 15);
    angles(&header.light_phi_deg, 5, 60);
    return header;
}

static float *random_values(gsize n, guint32 seed) {
    float *values = g_new(float, n);
    GRand *rand = g_rand_new_with_seed(seed);
    for (gsize i = 0; i < n; i++)
        values[i] = (float)g_rand_int_range(rand, -512, 2048) / 512; /* a half holds it */
    g_rand_free(rand);
    return values;
}

static void test_write_bdi(gconstpointer data) {
    const gboolean sparse = GPOINTER_TO_INT(data);
    struct bonn_header header = some_header(sparse ? BONN_BDI_SPARSE : BONN_BDI);
    g_autoptr(GError) error = NULL;
    g_autofree char *path = in_folder(sparse ? "ours-sparse" : "ours");
    g_autofree char *out = in_folder("ours.values");
    const gsize texels = 63, view = 5 * texels * 3;
    g_autofree float *values = random_values(2 * view, 1);
    guint8 mask[63];
    for (gsize t = 0; t < texels; t++)
        mask[t] = !sparse || t % 4 != 3;
    g_autoptr(BonnWriter) writer = bonn_writer_new(path, &header, mask, &error);
    g_assert_no_error(error);
    g_assert_true(bonn_writer_view(writer, 1, values + view, &error));
    g_assert_true(bonn_writer_view(writer, 0, values, &error));
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
    g_assert_true(bonn_writer_finish(writer, &error));
    for (gsize i = 0; i < 2 * view; i++)
        values[i] = mask[i / 3 % texels] ? values[i] : 0;
    peer("read", NULL, path, out);
    g_autofree float *got = values_of(out, 2 * view);
    g_assert_cmpmem(got, 2 * view * sizeof *got, values, 2 * view * sizeof *got);
    g_autoptr(BonnFile) file = open_good(path);
    assert_values(file, values, 1e-9, sparse ? 15 : 0);
    g_assert_cmpstr(bonn_header(file)->setup, ==, "Prüfstand");
    g_assert_cmpfloat_with_epsilon((double)bonn_header(file)->light_phi_deg[4], 240, 1e-4);
    bonn_header_clear(&header);
}

/* Views that are written together give the same file as views that are written one by one. */
static void test_write_together(gconstpointer data) {
    const gboolean sparse = GPOINTER_TO_INT(data);
    struct bonn_header header = some_header(sparse ? BONN_BDI_SPARSE : BONN_BDI);
    g_autofree char *single = in_folder("single.btf"), *together = in_folder("together.btf");
    const gsize texels = 63, row = 5 * 3, view = texels * row;
    g_autofree float *values = random_values(2 * view, 4);
    g_autofree float *sorted = g_new(float, 2 * view);
    g_autofree guint16 *halves = g_new(guint16, 2 * view);
    guint8 mask[63];
    for (gsize t = 0; t < texels; t++)
        mask[t] = t % 5 != 3;
    for (gsize v = 0; v < 2; v++) /* view, light, texel → texel, view, light */
        for (gsize l = 0; l < 5; l++)
            for (gsize t = 0; t < texels; t++)
                memcpy(sorted + ((t * 2 + v) * 5 + l) * 3, values + v * view + (l * texels + t) * 3,
                       3 * sizeof *sorted);
    exr_half_from_floats(halves, sorted, 2 * view);
    g_autoptr(BonnWriter) one = ok(bonn_writer_new(single, &header, mask, ERR));
    g_assert_true(ok(bonn_writer_view(one, 0, values, ERR)));
    g_assert_true(ok(bonn_writer_view(one, 1, values + view, ERR)));
    g_assert_true(ok(bonn_writer_finish(one, ERR)));
    g_autoptr(BonnWriter) both = ok(bonn_writer_new(together, &header, mask, ERR));
    g_assert_true(ok(bonn_writer_views(both, 0, 2, halves, 2, ERR)));
    g_assert_true(ok(bonn_writer_finish(both, ERR)));
    g_autofree char *a = NULL, *b = NULL;
    gsize a_bytes = 0, b_bytes = 0;
    g_assert_true(g_file_get_contents(single, &a, &a_bytes, NULL));
    g_assert_true(g_file_get_contents(together, &b, &b_bytes, NULL));
    g_assert_cmpmem(a, a_bytes, b, b_bytes);
    bonn_header_clear(&header);
}

static void test_write_factors(gconstpointer data) {
    const enum bonn_kind kind = (enum bonn_kind)GPOINTER_TO_INT(data);
    struct bonn_header header = some_header(kind);
    g_autofree char *path = in_folder(kind == BONN_FMF ? "ours-fmf" : "ours-dfmf");
    g_autofree char *out = in_folder("factors.values");
    const int k = 3, rows = kind == BONN_FMF ? 30 : 10, n = kind == BONN_FMF ? 1 : 3;
    const float s[3] = {3, 2, 1};
    g_autofree float *u = random_values((gsize)n * (gsize)rows * (gsize)k, 2);
    g_autofree float *sv = random_values((gsize)n * 63 * (gsize)k, 3);
    struct bonn_factors factors[3];
    for (int i = 0; i < n; i++)
        factors[i] = (struct bonn_factors){k, rows, 63, s, u + i * rows * k, sv + i * 63 * k};
    g_assert_true(ok(bonn_write_factors(path, &header, factors, ERR)));
    peer("read", NULL, path, out);
    g_autofree float *got = values_of(out, 2 * 5 * 63 * 3);
    const float *texel = n == 1 ? sv : sv + 2 * 63 * k; /* the last value is of the third matrix */
    const float *row = u + (n * rows - 1) * k;
    double last = 0;
    for (int i = 0; i < k; i++)
        last += (double)row[i] * (double)texel[62 * k + i];
    g_assert_cmpfloat_with_epsilon((double)got[2 * 5 * 63 * 3 - 1], last, 1e-5);
    g_autoptr(BonnFile) file = open_good(path);
    assert_values(file, got, 1e-5, 0);
    bonn_header_clear(&header);
}

/* Without waiting for the disk, as cutting a file that is there would. */
static void overwrite(const char *path, const char *bytes, gsize n) {
    g_unlink(path);
    FILE *file = fopen(path, "wb");
    g_assert_nonnull(file);
    g_assert_cmpuint(fwrite(bytes, 1, n, file), ==, n);
    fclose(file);
}

static void assert_refused(const char *path, const char *bytes, gsize n) {
    g_autoptr(GError) error = NULL;
    overwrite(path, bytes, n);
    BonnFile *file = bonn_open(path, &error);
    g_assert_null(file);
    g_assert_true(error && error->domain == BONN_ERROR);
    g_assert_true(g_str_has_prefix(error->message, path));
}

TEST(truncated) {
    static const char *const some[] = {"bdi", "bdi-sparse", "fmf", "fmf-old", "dfmf-3"};
    g_autofree char *cut = in_folder("cut");
    for (gsize i = 0; i < G_N_ELEMENTS(some); i++) {
        g_autofree char *path = in_folder(some[i]), *bytes = NULL;
        gsize length = 0;
        g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
        for (gsize n = 0; n < length; n++)
            assert_refused(cut, bytes, n);
    }
}

static void read_all(const BonnFile *file) {
    const struct bonn_header *header = bonn_header(file);
    const gsize n = (gsize)header->n_lights * (gsize)header->width * (gsize)header->height * 3;
    g_autofree float *rgb = g_new(float, n);
    g_autofree int *holes = g_new(int, header->n_lights);
    for (int view = 0; view < header->n_views; view++) {
        g_assert_true(bonn_read_view(file, view, rgb, holes, NULL));
        for (gsize i = 0; i < n; i++)
            g_assert_true(isfinite(rgb[i]));
    }
}

/* Bytes at random, and numbers that are too large or nearly right. */
static void mutate(char *bytes, gsize *length, GRand *rand) {
    static const guint32 numbers[] = {0, 1, 0xff, 0x7fffffff, 0x80000000, 0xffffffff};
    for (int i = g_rand_int_range(rand, 1, 5); i > 0; i--) {
        const gsize at = (gsize)g_rand_int_range(rand, 0, (int)*length - 4);
        if (g_rand_int_range(rand, 0, 3) == 0)
            memcpy(bytes + at, &numbers[g_rand_int_range(rand, 0, 6)], 4);
        else
            bytes[at] = (char)g_rand_int_range(rand, 0, 256);
    }
    if (g_rand_int_range(rand, 0, 8) == 0)
        *length = (gsize)g_rand_int_range(rand, 1, (int)*length);
}

TEST(mutated) {
    GRand *rand = g_rand_new_with_seed(5);
    g_autofree char *path = in_folder("mutated");
    int opened = 0, refused = 0;
    for (int i = 0; i < 4000; i++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *from = in_folder(kinds[i % G_N_ELEMENTS(kinds)]), *bytes = NULL;
        gsize length = 0;
        g_assert_true(g_file_get_contents(from, &bytes, &length, NULL));
        mutate(bytes, &length, rand);
        overwrite(path, bytes, length);
        g_autoptr(BonnFile) file = bonn_open(path, &error);
        g_assert_true((file != NULL) != (error != NULL));
        if (file)
            read_all(file);
        opened += file != NULL;
        refused += file == NULL;
    }
    g_test_message("%d opened, %d refused", opened, refused);
    g_assert_cmpint(opened, >, 500);
    g_assert_cmpint(refused, >, 500);
    g_rand_free(rand);
}

static void assert_says(const char *path, enum bonn_error code, const char *what) {
    g_autoptr(GError) error = NULL;
    BonnFile *file = bonn_open(path, &error);
    g_assert_null(file);
    g_assert_error(error, BONN_ERROR, (int)code);
    g_assert_nonnull(strstr(error->message, what));
}

static void patch(const char *from, const char *to, gssize at, guint32 value) {
    g_autofree char *bytes = NULL;
    gsize length = 0;
    g_assert_true(g_file_get_contents(from, &bytes, &length, NULL));
    memcpy(bytes + (at < 0 ? (gssize)length + at : at), &value, sizeof value);
    g_assert_true(g_file_set_contents(to, bytes, (gssize)length, NULL));
}

TEST(messages) {
    g_autofree char *bdi = in_folder("bdi"), *path = in_folder("patched");
    g_autofree char *dfmf = in_folder("dfmf-0");
    const gssize metadata = 10 + 4 + 4 + 240 + 16 + 4 + 4 + 11;
    const gssize sampling = metadata + 4 + 3 * 5;
    const gssize size = sampling + 4 + VIEWS * (12 + LIGHTS * 8);
    const struct {
        const char *of;
        gssize at;
        guint32 value;
        enum bonn_error code;
        const char *what;
    } bad[] = {
        {bdi, metadata, 31, BONN_ERROR_UNSUPPORTED, "31 channels"},
        {bdi, size - 8, 0, BONN_ERROR_UNSUPPORTED, "the lights of view 2 differ"},
        {bdi, size, 100000, BONN_ERROR_FORMAT, "the width is 100000, but must be from 1 to 8192"},
        {bdi, size + 12, 0x01010101, BONN_ERROR_UNSUPPORTED, "bzip2"},
        {bdi, size, WIDTH - 1, BONN_ERROR_FORMAT, "the file is cut off"},
        {dfmf, size + 8 + 4 + 4, 6, BONN_ERROR_UNSUPPORTED, "the colour model is 6"},
        {dfmf, size, WIDTH + 1, BONN_ERROR_FORMAT, "does not fit 6 × 3 texels"},
    };
    assert_says("/nonexistent.btf", BONN_ERROR_IO, "No such file");
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        patch(bad[i].of, path, bad[i].at, bad[i].value);
        assert_says(path, bad[i].code, bad[i].what);
    }
}

/* Cut off between its being opened and its being read. */
TEST(cut_at_work) {
    g_autofree char *bdi = in_folder("bdi"), *path = in_folder("cut-at-work");
    g_autoptr(GError) error = NULL;
    float rgb[LIGHTS * TEXELS * 3];
    int holes[LIGHTS];
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(bdi, &bytes, &length, NULL));
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    g_autoptr(BonnFile) file = open_good(path);
    g_assert_cmpint(truncate(path, 0), ==, 0);
    g_assert_false(bonn_read_view(file, 0, rgb, holes, &error));
    g_assert_error(error, BONN_ERROR, BONN_ERROR_FORMAT);
    g_assert_nonnull(strstr(error->message, "shorter"));
    g_assert_nonnull(strstr(error->message, path));
}

/* A file that is nearly nothing but its mask says that a view has 12 GB. */
TEST(large_views) {
    g_autofree char *bdi = in_folder("bdi"), *path = in_folder("large"), *bytes = NULL;
    g_autoptr(GError) error = NULL;
    const guint32 size[2] = {GUINT32_TO_LE(8192), GUINT32_TO_LE(8192)};
    const guint8 at_size[8] = {5, 0, 0, 0, 3, 0, 0, 0};
    gsize length;
    g_assert_true(g_file_get_contents(bdi, &bytes, &length, NULL));
    char *at = memmem(bytes, length, at_size, sizeof at_size);
    g_assert_nonnull(at);
    memcpy(at, size, sizeof size);
    g_assert_true(g_file_set_contents(path, bytes, (gssize)length, NULL));
    g_assert_null(bonn_open(path, &error));
    g_assert_nonnull(strstr(error->message, "3072 MiB"));
}

/* Infinities are holes, not values. */
TEST(not_finite) {
    g_autofree char *bdi = in_folder("bdi"), *path = in_folder("infinite");
    float rgb[LIGHTS * TEXELS * 3];
    int holes[LIGHTS];
    patch(bdi, path, -4, 0x7c003c00);
    g_autoptr(BonnFile) file = open_good(path);
    g_assert_true(ok(bonn_read_view(file, VIEWS - 1, rgb, holes, ERR)));
    g_assert_cmpint(holes[LIGHTS - 2], ==, 0);
    g_assert_cmpint(holes[LIGHTS - 1], ==, 1);
    g_assert_cmpfloat(rgb[LIGHTS * TEXELS * 3 - 3], ==, 0);
}

TEST(no_room) {
    struct bonn_header header = some_header(BONN_BDI);
    g_autoptr(GError) error = NULL;
    g_autofree char *path = in_folder("no/such/folder.btf");
    g_assert_null(bonn_writer_new(path, &header, NULL, &error));
    g_assert_error(error, BONN_ERROR, BONN_ERROR_IO);
    bonn_header_clear(&header);
}

BEFORE_TESTS {
    folder_make();
    g_test_add_data_func("/bonn/write/full", GINT_TO_POINTER(FALSE), test_write_bdi);
    g_test_add_data_func("/bonn/write/sparse", GINT_TO_POINTER(TRUE), test_write_bdi);
    g_test_add_data_func("/bonn/write/full-together", GINT_TO_POINTER(FALSE), test_write_together);
    g_test_add_data_func("/bonn/write/sparse-together", GINT_TO_POINTER(TRUE), test_write_together);
    g_test_add_data_func("/bonn/write/fmf", GINT_TO_POINTER(BONN_FMF), test_write_factors);
    g_test_add_data_func("/bonn/write/dfmf", GINT_TO_POINTER(BONN_DFMF), test_write_factors);
}

AFTER_TESTS {
    folder_remove();
}
