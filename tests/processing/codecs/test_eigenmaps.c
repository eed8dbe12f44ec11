#include "base/data_error.h"
#include "codecs/eigenmaps/eigenmaps.h"

#include "exr/exr.h"
#include "lib/btf_fixture.h"
#include "lib/damage.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "pipeline/pipeline.h"

#include <cblas.h>
#include <glib/gstdio.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

struct matrix {
    int rows, columns;
    double *values; /* row by row */
    int asked;
};

static gboolean give_column(int view, float *ret, gpointer data, GError **error) {
    struct matrix *matrix = data;
    matrix->asked++;
    for (int i = 0; i < matrix->rows; i++)
        ret[i] = (float)matrix->values[i * matrix->columns + view];
    return TRUE;
}

/* n_lights × height × width × 3 rows, of a rank, with noise. */
static struct matrix random_matrix(int rows, int columns, int rank, double noise) {
    struct matrix matrix = {rows, columns, g_new0(double, rows *columns), 0};
    GRand *random = g_rand_new_with_seed(11);
    for (int r = 0; r < rank; r++) {
        g_autofree double *left = g_new(double, rows), *right = g_new(double, columns);
        for (int i = 0; i < rows; i++)
            left[i] = g_rand_double_range(random, -1, 1) / (r + 1);
        for (int i = 0; i < columns; i++)
            right[i] = g_rand_double_range(random, -1, 1);
        for (int i = 0; i < rows * columns; i++)
            matrix.values[i] += left[i / columns] * right[i % columns];
    }
    for (int i = 0; i < rows * columns; i++)
        matrix.values[i] = (float)(matrix.values[i] + noise * g_rand_double_range(random, -1, 1));
    g_rand_free(random);
    return matrix;
}

static struct eigenmaps *new_maps(int width, int height, int n_lights, int n_views, int n_terms) {
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    *maps = (struct eigenmaps){.name = g_strdup("weave"),
                               .layout.width = (gsize)width,
                               .layout.height = (gsize)height,
                               .layout.texel_mm = 0.5,
                               .layout.reference_mm = 5,
                               .layout.views = btf_fixture_line(n_views, 1, 2),
                               .layout.lights = btf_fixture_line(n_lights, 3, 4),
                               .n_terms = n_terms};
    return maps;
}

static double residual(const struct eigenmaps *maps, const struct matrix *matrix) {
    double rest = 0, all = 0;
    for (int i = 0; i < matrix->rows; i++)
        for (int v = 0; v < matrix->columns; v++) {
            double value = matrix->values[i * matrix->columns + v], sum = 0;
            for (int t = 0; t < maps->n_terms; t++)
                sum += (double)maps->weights[t * matrix->columns + v] *
                       maps->maps[(gsize)t * (gsize)matrix->rows + (gsize)i];
            rest += (value - sum) * (value - sum);
            all += value * value;
        }
    return sqrt(rest / all);
}

TEST(low_rank) {
    struct matrix matrix = random_matrix(3 * 5 * 4 * 3, 9, 3, 0);
    struct eigenmaps *maps = new_maps(5, 4, 3, 9, 3);
    double error;
    g_assert_true(eigenmaps_compute(maps, give_column, &matrix, &error, NULL));
    g_assert_cmpfloat(error, <, 1e-5);
    g_assert_cmpfloat(residual(maps, &matrix), <, 1e-5);
    eigenmaps_free(maps);
    g_free(matrix.values);
}

/* Against a dense singular value decomposition. */
TEST(dense) {
    enum { ROWS = 4 * 6 * 5 * 3, VIEWS = 12, TERMS = 4 };
    struct matrix matrix = random_matrix(ROWS, VIEWS, 8, 0.2);
    struct eigenmaps *maps = new_maps(6, 5, 4, VIEWS, TERMS);
    double error, s[VIEWS], vt[VIEWS * VIEWS], superb[VIEWS];
    g_assert_true(eigenmaps_compute(maps, give_column, &matrix, &error, NULL));
    g_autofree double *a = g_memdup2(matrix.values, sizeof(double) * ROWS * VIEWS);
    g_assert_cmpint(LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'N', 'A', ROWS, VIEWS, a, VIEWS, s, NULL, ROWS,
                                   vt, VIEWS, superb),
                    ==, 0);
    double rest = 0, all = 0;
    for (int i = 0; i < VIEWS; i++) {
        all += s[i] * s[i];
        rest += i >= TERMS ? s[i] * s[i] : 0;
    }
    g_assert_cmpfloat_with_epsilon(error, sqrt(rest / all), 1e-9);
    g_assert_cmpfloat_with_epsilon(residual(maps, &matrix), error, 1e-6);
    for (int t = 0; t < TERMS; t++) {
        double product = 0, largest = 0;
        for (int v = 0; v < VIEWS; v++) {
            double w = maps->weights[t * VIEWS + v];
            product += w * vt[t * VIEWS + v];
            largest = fabs(w) > fabs(largest) ? w : largest;
        }
        g_assert_cmpfloat_with_epsilon(fabs(product), 1, 1e-6);
        g_assert_cmpfloat(largest, >, 0);
    }
    eigenmaps_free(maps);
    g_free(matrix.values);
}

/* Neither the memory there is nor the number of threads makes a difference. */
TEST(blocks) {
    enum { ROWS = 7 * 20 * 16 * 3, VIEWS = 11, TERMS = 3 };
    struct matrix matrix = random_matrix(ROWS, VIEWS, 6, 0.1);
    struct eigenmaps *whole = new_maps(20, 16, 7, VIEWS, TERMS);
    double error, part_error;
    g_assert_true(eigenmaps_compute(whole, give_column, &matrix, &error, NULL));
    g_assert_cmpint(matrix.asked, ==, VIEWS);
    for (gsize columns = 0; columns < 6; columns++) {
        struct eigenmaps *part = new_maps(20, 16, 7, VIEWS, TERMS);
        openblas_set_num_threads(columns % 2 ? 1 : 4);
        const struct eigenmaps_options options = {MAX(columns * ROWS * sizeof(float), 1),
                                                  .method = EIGENMAPS_EXACT};
        g_assert_true(
            eigenmaps_compute_with(part, &options, give_column, &matrix, &part_error, NULL));
        g_assert_cmpfloat_with_epsilon(part_error, error, 1e-12);
        for (int i = 0; i < VIEWS * TERMS; i++)
            g_assert_cmpfloat_with_epsilon(part->weights[i], whole->weights[i], 1e-6);
        eigenmaps_free(part);
    }
    struct eigenmaps *again = new_maps(20, 16, 7, VIEWS, TERMS);
    openblas_set_num_threads(2);
    g_assert_true(eigenmaps_compute(again, give_column, &matrix, &part_error, NULL));
    g_assert_cmpmem(again->maps, ROWS * TERMS * sizeof(float), whole->maps,
                    ROWS * TERMS * sizeof(float));
    g_assert_true(error == part_error);
    eigenmaps_free(again);
    eigenmaps_free(whole);
    g_free(matrix.values);
}

/* The matrix of give_part(), and how the rows are divided. */
struct divided {
    struct matrix matrix; /* first member: give_column() takes it */
    gsize lights, texels;
    gboolean by_lights;
    gsize most; /* largest number of lights or texels that were requested together */
};

static gboolean give_part(int view, gsize first, gsize n, float *ret, gpointer data,
                          GError **error) {
    struct divided *divided = data;
    const struct matrix *matrix = &divided->matrix;
    const gsize lights = divided->by_lights ? n : divided->lights;
    const gsize texels = divided->by_lights ? divided->texels : n;
    divided->most = MAX(divided->most, n);
    for (gsize light = 0; light < lights; light++)
        for (gsize i = 0; i < texels * 3; i++) {
            const gsize row = divided->by_lights ? (first + light) * divided->texels * 3 + i
                                                 : light * divided->texels * 3 + first * 3 + i;
            ret[light * texels * 3 + i] =
                (float)matrix->values[row * (gsize)matrix->columns + (gsize)view];
        }
    return TRUE;
}

/* Maps in a file are those in memory, whether they are computed light by light or texel by texel.
 * The file written from them has the same values. */
TEST(in_file) {
    enum { ROWS = 24 * 20 * 16 * 3, VIEWS = 30, TERMS = 4 };
    struct divided divided = {random_matrix(ROWS, VIEWS, 12, 0.1), 24, 20 * 16};
    g_autofree char *folder = g_dir_make_tmp("eigenmaps-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "maps.exr", NULL);
    struct eigenmaps *memory = new_maps(20, 16, 24, VIEWS, TERMS);
    const struct eigenmaps_options plain = {.memory = 20 * ROWS * sizeof(float),
                                            .method = EIGENMAPS_RANDOMISED};
    double error;
    ok(eigenmaps_compute_with(memory, &plain, give_column, &divided.matrix, &error, ERR));
    for (int by_lights = 0; by_lights < 2; by_lights++) {
        struct eigenmaps *maps = new_maps(20, 16, 24, VIEWS, TERMS);
        const struct eigenmaps_options options = {.memory = 8 * ROWS * sizeof(float),
                                                  .folder = folder,
                                                  .part = give_part,
                                                  .lights = by_lights};
        double in_file;
        divided.by_lights = by_lights;
        divided.most = 0;
        ok(eigenmaps_compute_with(maps, &options, give_column, &divided, &in_file, ERR));
        g_assert_cmpuint(divided.most, <, by_lights ? 24 : 320);
        g_assert_null(maps->maps);
        g_assert_cmpfloat_with_epsilon(in_file, error, 1e-6);
        g_assert_cmpfloat_with_epsilon(eigenmaps_rounded_error(maps, in_file),
                                       eigenmaps_rounded_error(memory, error), 1e-6);
        ok(eigenmaps_write(path, maps, ERR));
        eigenmaps_free(maps);
        struct eigenmaps *read = ok(eigenmaps_read(path, ERR));
        for (int i = 0; i < VIEWS * TERMS; i++)
            g_assert_cmpfloat_with_epsilon(read->weights[i], memory->weights[i], 1e-5);
        for (int i = 0; i < ROWS * TERMS; i++)
            g_assert_cmpfloat_with_epsilon(read->maps[i], memory->maps[i], 4e-3);
        eigenmaps_free(read);
    }
    remove_tree(folder);
    eigenmaps_free(memory);
    g_free(divided.matrix.values);
}

/* n_views columns of orthonormal times given singular values times orthonormal: rows are cosines,
 * so that nothing need be solved to know the truth. */
static struct matrix known_matrix(int rows, int columns, const double *values, int n) {
    struct matrix matrix = {rows, columns, g_new0(double, rows *columns), 0};
    for (int i = 0; i < rows; i++)
        for (int v = 0; v < columns; v++)
            for (int r = 0; r < n; r++)
                matrix.values[i * columns + v] +=
                    values[r] * sqrt(2.0 / rows) * cos(G_PI * (r + 1) * (i + 0.5) / rows) *
                    sqrt(2.0 / columns) * cos(G_PI * (r + 1) * (v + 0.5) / columns);
    return matrix;
}

/* That the Gram matrix has squares of singular values does not show where floats end. */
TEST(ill_conditioned) {
    enum { ROWS = 24 * 20 * 16 * 3, VIEWS = 40, TERMS = 4 };
    static const double values[TERMS] = {100, 1, 1e-2, 2e-4};
    static const enum eigenmaps_method methods[] = {EIGENMAPS_EXACT, EIGENMAPS_RANDOMISED};
    struct matrix matrix = known_matrix(ROWS, VIEWS, values, TERMS);
    for (guint m = 0; m < G_N_ELEMENTS(methods); m++) {
        const struct eigenmaps_options options = {.method = methods[m]};
        struct eigenmaps *maps = new_maps(20, 16, 24, VIEWS, TERMS);
        double error;
        g_assert_true(eigenmaps_compute_with(maps, &options, give_column, &matrix, &error, NULL));
        for (int t = 0; t < TERMS; t++) {
            double product = 0, square = 0;
            for (int v = 0; v < VIEWS; v++)
                product += maps->weights[t * VIEWS + v] * sqrt(2.0 / VIEWS) *
                           cos(G_PI * (t + 1) * (v + 0.5) / VIEWS);
            for (int i = 0; i < ROWS; i++)
                square += pow(maps->maps[t * ROWS + i], 2);
            g_test_message("method %u, term %d: %g, %g", m, t, fabs(product), sqrt(square));
            g_assert_cmpfloat_with_epsilon(fabs(product), 1, 1e-3);
            g_assert_cmpfloat_with_epsilon(sqrt(square) / values[t], 1, 1e-2);
        }
        eigenmaps_free(maps);
    }
    g_free(matrix.values);
}

/* Of more rows than the sketch has, with noise, against a dense singular value decomposition: with
 * hardly any memory, which leaves no directions to spare, and with more. */
TEST(randomised) {
    enum { ROWS = 24 * 20 * 16 * 3, VIEWS = 30, TERMS = 4 };
    struct matrix matrix = random_matrix(ROWS, VIEWS, 12, 0.1);
    double s[VIEWS], superb[VIEWS], rest = 0, all = 0, error;
    g_autofree double *a = g_memdup2(matrix.values, sizeof(double) * ROWS * VIEWS);
    g_assert_cmpint(LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'N', 'N', ROWS, VIEWS, a, VIEWS, s, NULL, ROWS,
                                   NULL, VIEWS, superb),
                    ==, 0);
    for (int i = 0; i < VIEWS; i++) {
        all += s[i] * s[i];
        rest += i >= TERMS ? s[i] * s[i] : 0;
    }
    const double best = sqrt(rest / all);
    for (gsize columns = 1; columns < 30; columns += 8) {
        const struct eigenmaps_options options = {columns * ROWS * sizeof(float)};
        struct eigenmaps *maps = new_maps(20, 16, 24, VIEWS, TERMS);
        matrix.asked = 0;
        g_assert_true(eigenmaps_compute_with(maps, &options, give_column, &matrix, &error, NULL));
        g_assert_cmpint(matrix.asked, ==, 2 * VIEWS);
        g_test_message("%d columns: %g of %g", (int)columns, error, best);
        g_assert_cmpfloat(error, >=, best * (1 - 1e-6));
        g_assert_cmpfloat(error, <=, best * (columns > 1 ? 1.0005 : 1.002));
        g_assert_cmpfloat_with_epsilon(residual(maps, &matrix), error, 1e-5);
        for (int t = 0; t < TERMS; t++)
            for (int u = 0; u <= t; u++)
                g_assert_cmpfloat_with_epsilon(
                    cblas_sdot(VIEWS, maps->weights + t * VIEWS, 1, maps->weights + u * VIEWS, 1),
                    t == u, 1e-5);
        eigenmaps_free(maps);
    }
    g_free(matrix.values);
}

/* The fewest terms that reach an error, whichever way. */
TEST(target) {
    enum { ROWS = 24 * 20 * 16 * 3, VIEWS = 30 };
    static const enum eigenmaps_method methods[] = {EIGENMAPS_EXACT, EIGENMAPS_RANDOMISED};
    struct matrix matrix = random_matrix(ROWS, VIEWS, 12, 0.02);
    int terms[2];
    for (guint m = 0; m < G_N_ELEMENTS(methods); m++) {
        g_autoptr(GError) failed = NULL;
        struct eigenmaps_options options = {.target = 0.15, .method = methods[m]};
        struct eigenmaps *maps = new_maps(20, 16, 24, VIEWS, VIEWS);
        double error, fewer;
        g_assert_true(eigenmaps_compute_with(maps, &options, give_column, &matrix, &error, NULL));
        terms[m] = maps->n_terms;
        g_assert_cmpfloat(error, <=, 0.15);
        g_assert_cmpfloat_with_epsilon(residual(maps, &matrix), error, 1e-5);
        maps->n_terms--;
        g_assert_cmpfloat(residual(maps, &matrix), >, 0.15);
        g_assert_cmpint(terms[m], >, 2);
        g_assert_cmpint(terms[m], <, 12);
        options.target = 0;
        maps->n_terms = 2;
        g_assert_true(eigenmaps_compute_with(maps, &options, give_column, &matrix, &fewer, NULL));
        options.target = fewer * 0.99;
        g_assert_false(
            eigenmaps_compute_with(maps, &options, give_column, &matrix, &error, &failed));
        g_assert_error(failed, DATA_ERROR, DATA_ERROR_INVALID);
        g_assert_nonnull(strstr(failed->message, "with 2 eigen-maps"));
        eigenmaps_free(maps);
    }
    g_assert_cmpint(terms[0], ==, terms[1]);
    g_free(matrix.values);
}

static gboolean fail_column(int view, float *ret, gpointer data, GError **error) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_IO, "the disk is gone");
    return FALSE;
}

TEST(refused) {
    g_autoptr(GError) error = NULL;
    struct matrix matrix = random_matrix(2 * 3 * 3 * 3, 4, 2, 0.1);
    double ret;
    static const int terms[] = {0, -1, 5};
    for (guint i = 0; i < G_N_ELEMENTS(terms); i++) {
        struct eigenmaps *maps = new_maps(3, 3, 2, 4, terms[i]);
        g_assert_false(eigenmaps_compute(maps, give_column, &matrix, &ret, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_clear_error(&error);
        eigenmaps_free(maps);
    }
    struct eigenmaps *maps = new_maps(3, 3, 2, 4, 2);
    g_assert_false(eigenmaps_compute(maps, fail_column, NULL, &ret, &error));
    g_assert_error(error, EXR_ERROR, EXR_ERROR_IO);
    g_clear_error(&error);
    matrix.values[2] = NAN;
    g_assert_false(eigenmaps_compute(maps, give_column, &matrix, &ret, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "view 2"));
    eigenmaps_free(maps);
    g_free(matrix.values);
}

/* All black: no division by nothing. */
TEST(black) {
    struct matrix matrix = random_matrix(2 * 3 * 3 * 3, 4, 0, 0);
    struct eigenmaps *maps = new_maps(3, 3, 2, 4, 2);
    double error = -1;
    g_assert_true(eigenmaps_compute(maps, give_column, &matrix, &error, NULL));
    g_assert_cmpfloat(error, ==, 0);
    eigenmaps_free(maps);
    g_free(matrix.values);
}

static struct eigenmaps *computed(void) {
    struct matrix matrix = random_matrix(2 * 6 * 5 * 3, 4, 2, 0.1);
    struct eigenmaps *maps = new_maps(6, 5, 2, 4, 3);
    double error;
    g_assert_true(eigenmaps_compute(maps, give_column, &matrix, &error, NULL));
    g_free(matrix.values);
    return maps;
}

TEST(file) {
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "eigenmaps.exr", NULL);
    struct eigenmaps *maps = computed();
    ok(eigenmaps_write(path, maps, ERR));
    struct eigenmaps *back = ok(eigenmaps_read(path, ERR));
    g_assert_cmpstr(back->name, ==, "weave");
    g_assert_cmpint(back->layout.views.n, ==, 4);
    g_assert_cmpint(back->layout.lights.n, ==, 2);
    g_assert_cmpint(back->n_terms, ==, 3);
    g_assert_cmpint(back->layout.width, ==, 6);
    g_assert_cmpint(back->layout.height, ==, 5);
    g_assert_cmpfloat(back->layout.texel_mm, ==, 0.5);
    g_assert_cmpfloat(back->layout.reference_mm, ==, 5);
    g_assert_cmpfloat(back->layout.lights.phi_deg[1], ==, 4);
    g_assert_cmpfloat(back->layout.views.theta_deg[3], ==, 3);
    g_assert_cmpmem(back->weights, 12 * sizeof(float), maps->weights, 12 * sizeof(float));
    for (int i = 0; i < 3 * 2 * 6 * 5 * 3; i++)
        g_assert_cmpfloat_with_epsilon(back->maps[i], maps->maps[i],
                                       1e-3 * fabs(maps->maps[i]) + 1e-6);
    eigenmaps_free(back);
    eigenmaps_free(maps);

    assert_cut_refused(eigenmaps_read, path, 211);
    g_unlink(path);
    g_assert_null(eigenmaps_read(path, &error));
    g_assert_nonnull(strstr(error->message, "eigenmaps.exr"));
}

/* Valid EXR files that are not valid eigen-maps. */
TEST(hostile) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "eigenmaps.exr", NULL);
    for (int fault = 0; fault < 6; fault++) {
        g_autoptr(GError) error = NULL;
        struct eigenmaps *maps = computed();
        g_assert_true(eigenmaps_write(path, maps, &error));
        eigenmaps_free(maps);
        struct exr_file *file = ok(exr_read(path, ERR));
        if (fault == 0)
            g_ptr_array_remove_index(file->parts, 0);
        if (fault == 1)
            g_ptr_array_remove_index(file->parts, 1);
        if (fault == 2)
            g_ptr_array_remove_index(file->parts, file->parts->len - 1);
        if (fault == 3)
            exr_part_plane(exr_file_part(file, "weights"), "W")[3] = NAN;
        if (fault == 4)
            exr_part_plane(exr_file_part(file, "E001_light_0001"), "G")[7] = NAN;
        if (fault == 5)
            exr_part_plane(exr_file_part(file, "lights"), "phi_deg")[1] = INFINITY;
        assert_file_refused(eigenmaps_read, path, file);
    }
}
