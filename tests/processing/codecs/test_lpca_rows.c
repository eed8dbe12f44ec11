/* Where the rows of a local PCA come from: memory, a file, the memories of several processes; and
 * in which colours. */
#include "base/data_error.h"
#include "btf/btf_matrix_private.h"
#include "codecs/lpca/lpca.h"
#include "exr/exr_half.h"
#include "lib/btf_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define VIEWS  5
#define LIGHTS 6

/* Glossy bumps, in halves, that no few components hold exactly. */
static struct btf_matrix *bumps(int size) {
    struct btf_matrix *btf = btf_fixture_new("bumps", size, size, VIEWS, LIGHTS);
    const gsize d = VIEWS * LIGHTS * 3, n = (gsize)(size * size) * d;
    g_autofree guint16 *halves = g_new(guint16, n);
    for (gsize i = 0; i < n; i++) {
        const double x = (double)(i / d % (gsize)size), y = (double)(i / d / (gsize)size);
        const double v = (double)(i / (LIGHTS * 3) % VIEWS), l = (double)(i / 3 % LIGHTS);
        const double tilt = sin(0.7 * x + v) * cos(0.5 * y - l);
        btf->values[i] = (float)(0.2 + 0.1 * sin(0.3 * x * y + (double)(i % 3)) + 0.1 * tilt +
                                 exp(-8 * (tilt - 0.5) * (tilt - 0.5)));
    }
    exr_half_from_floats(halves, btf->values, n);
    exr_half_to_floats(btf->values, halves, n);
    return btf;
}

static void move_to_file(struct btf_matrix *btf) {
    const gsize row = LIGHTS * 3, texels = btf_layout_texels(&btf->layout);
    g_autofree float *view = g_new(float, texels *row);
    g_autoptr(GError) error = NULL;
    btf->scratch = ok(btf_scratch_new(g_get_tmp_dir(), row, VIEWS, (int)texels, ERR));
    for (gsize v = 0; v < VIEWS; v++) {
        for (gsize x = 0; x < texels; x++)
            memcpy(view + x * row, btf->values + (x * VIEWS + v) * row, sizeof(float) * row);
        g_assert_true(btf_scratch_write(btf->scratch, (int)v, view, &error));
    }
    g_clear_pointer(&btf->values, g_free);
}

static double residual(const struct lpca *lpca, const struct btf_matrix *btf) {
    const gsize d = VIEWS * LIGHTS * 3;
    g_autofree float *sum = g_new(float, d);
    double rest = 0, all = 0;
    for (gsize x = 0; x < btf_layout_texels(&btf->layout); x++) {
        lpca_reconstruct(lpca, x, sum);
        for (gsize j = 0; j < d; j++) {
            const double value = btf->values[(gsize)x * d + j];
            rest += (value - sum[j]) * (value - sum[j]);
            all += value * value;
        }
    }
    return sqrt(rest / all);
}

TEST(file) {
    g_autoptr(BtfMatrix) btf = bumps(40), file = bumps(40);
    const struct lpca_options options = {6, 4};
    g_autoptr(GError) error = NULL;
    move_to_file(file);
    g_autoptr(Lpca) a = lpca_compute(btf, &options, &error);
    g_autoptr(Lpca) b = lpca_compute(file, &options, &error);
    g_assert_no_error(error);
    g_assert_cmpmem(a->clusters, 1600 * sizeof(int), b->clusters, 1600 * sizeof(int));
    g_assert_cmpfloat(a->error, >, 0.005);
    g_assert_cmpfloat_with_epsilon(a->error, b->error, 1e-6);
    g_assert_cmpfloat_with_epsilon(residual(b, btf), b->error, 1e-6);
    g_assert_cmpfloat_with_epsilon(lpca_error(a, file, 0), b->error, 1e-6);
}

/* Rows in another order, of few values and of more than are converted at a time. */
TEST(places) {
    static const int places[] = {2, 0, 3, 1};
    static const gsize lengths[] = {18, 5000, 20001};
    for (guint l = 0; l < G_N_ELEMENTS(lengths); l++) {
        const gsize row = lengths[l];
        g_autofree float *view = g_new(float, 5 * row), *back = g_new(float, 4 * row);
        g_autoptr(GError) error = NULL;
        struct btf_scratch *scratch = ok(btf_scratch_new(g_get_tmp_dir(), row, 2, 5, ERR));
        for (gsize i = 0; i < 5 * row; i++)
            view[i] = (float)(i / row) + (float)(i % 64) / 64; /* halves exactly */
        g_assert_true(btf_scratch_write(scratch, 1, view, &error));
        g_assert_true(btf_scratch_place_rows(scratch, 1, 1, 4, places, back, &error));
        for (gsize i = 0; i < 4; i++)
            g_assert_cmpmem(back + (gsize)places[i] * row, sizeof(float) * row,
                            view + (i + 1) * row, sizeof(float) * row);
        g_assert_false(btf_scratch_place_rows(scratch, 1, 4, 4, places, back, &error));
        g_assert_nonnull(error);
        /* Threads may write rows of the same view, so that only a whole view gets a hash. */
        ok(btf_scratch_write_rows(scratch, 0, 0, 5, view, ERR));
        g_assert_cmpuint(btf_scratch_hash(scratch, 0), ==, 0);
        g_assert_cmpuint(btf_scratch_hash(scratch, 1), !=, 0);
        btf_scratch_free(scratch);
    }
}

TEST(memory) {
    g_autoptr(BtfMatrix) btf = bumps(12);
    struct lpca_options options = {2, 2, .memory = 1000};
    g_autoptr(GError) error = NULL;
    g_assert_null(lpca_compute(btf, &options, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "allow more memory, or fewer"));
    g_clear_error(&error);
    options.memory = lpca_memory(btf, &options);
    g_autoptr(Lpca) lpca = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
}

/* Threads instead of processes: each with the rows of its part only. */
#define MAX_RANKS 4
struct table {
    GMutex lock;
    GCond all;
    int n, here, round;
    const void *given[MAX_RANKS];
};

/* Returns when all ranks have called it. */
static void meet(struct table *table) {
    g_mutex_lock(&table->lock);
    const int round = table->round;
    if (++table->here == table->n) {
        table->here = 0;
        table->round++;
        g_cond_broadcast(&table->all);
    }
    while (round == table->round)
        g_cond_wait(&table->all, &table->lock);
    g_mutex_unlock(&table->lock);
}

static void sum_floats(const struct team *team, float *values, gsize n) {
    struct table *table = team->data;
    g_autofree float *copy = g_memdup2(values, sizeof(float) * n);
    table->given[team->rank] = copy;
    meet(table);
    for (gsize i = 0; i < n; i++) {
        values[i] = 0;
        for (int rank = 0; rank < table->n; rank++)
            values[i] += ((const float *)table->given[rank])[i];
    }
    meet(table);
}

static void sum_doubles(const struct team *team, double *values, gsize n) {
    struct table *table = team->data;
    g_autofree double *copy = g_memdup2(values, sizeof(double) * n);
    table->given[team->rank] = copy;
    meet(table);
    for (gsize i = 0; i < n; i++) {
        values[i] = 0;
        for (int rank = 0; rank < table->n; rank++)
            values[i] += ((const double *)table->given[rank])[i];
    }
    meet(table);
}

static void share(const struct team *team, void *all, const gsize *starts) {
    struct table *table = team->data;
    table->given[team->rank] = all;
    meet(table);
    for (int rank = 0; rank < table->n; rank++)
        if (rank != team->rank)
            memcpy((guint8 *)all + starts[rank], (const guint8 *)table->given[rank] + starts[rank],
                   starts[rank + 1] - starts[rank]);
    meet(table);
}

struct member {
    struct team team;
    const struct btf_matrix *whole;
    struct lpca *lpca;
};

static gpointer work(gpointer data) {
    struct member *member = data;
    struct btf_matrix part = *member->whole;
    const gsize d = VIEWS * LIGHTS * 3;
    int first, end;
    const struct lpca_options options = {6, 4, .work.n_threads = 1, .team = &member->team};
    team_part(&member->team, member->team.rank, btf_layout_texels(&part.layout), TEAM_ROWS, &first,
              &end);
    part.values =
        g_memdup2(part.values + (gsize)first * d, sizeof(float) * MAX(1, (gsize)(end - first) * d));
    member->lpca = lpca_compute(&part, &options, NULL);
    g_free(part.values);
    return NULL;
}

/* Five blocks of rows: of four ranks one has two, and none is like another. */
TEST(team) {
    g_autoptr(BtfMatrix) btf = bumps(35);
    const struct lpca_options options = {6, 4};
    g_autoptr(Lpca) alone = lpca_compute(btf, &options, NULL);
    for (int n = 1; n <= MAX_RANKS; n *= 2) {
        struct member members[MAX_RANKS] = {0};
        struct table table = {.n = n};
        GThread *threads[MAX_RANKS];
        g_mutex_init(&table.lock);
        g_cond_init(&table.all);
        for (int i = 0; i < n; i++) {
            members[i] = (struct member){{i, n, &table, sum_floats, sum_doubles, share}, btf, NULL};
            threads[i] = g_thread_new("rank", work, &members[i]);
        }
        for (int i = 0; i < n; i++)
            g_thread_join(threads[i]);
        for (int i = 0; i < n; i++) {
            const struct lpca *lpca = members[i].lpca;
            g_assert_nonnull(lpca);
            g_assert_cmpmem(lpca->clusters, 1225 * sizeof(int), alone->clusters,
                            1225 * sizeof(int));
            g_assert_cmpfloat_with_epsilon(lpca->error, alone->error, 1e-6);
            g_assert_cmpfloat_with_epsilon(residual(lpca, btf), lpca->error, 1e-6);
        }
        for (int i = 0; i < n; i++)
            lpca_free(members[i].lpca);
        g_mutex_clear(&table.lock);
        g_cond_clear(&table.all);
    }
}

TEST(log) {
    float values[] = {0.5F, 0.3F, 0.1F, 0, 0, 0, 4, 7, 9, 0.001F, 0.002F, 0, 0.2F, 0.2F, 0.2F};
    float back[G_N_ELEMENTS(values)];
    memcpy(back, values, sizeof values);
    lpca_to_log(back, G_N_ELEMENTS(values) / 3);
    g_assert_cmpfloat_with_epsilon(back[0], log(0.2126 * 0.5 + 0.7152 * 0.3 + 0.0722 * 0.1 + 0.01),
                                   1e-5);
    g_assert_cmpfloat_with_epsilon(back[13], 0, 1e-6); /* grey has no chroma */
    lpca_from_log(back, G_N_ELEMENTS(values) / 3);
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++)
        g_assert_cmpfloat_with_epsilon(back[i], values[i], 1e-5);
}

/* Texels of one shape and colour but of many brightnesses are one component in logarithms: what a
 * factor is there is a sum. */
TEST(log_compute) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lpca.exr", NULL);
    g_autoptr(BtfMatrix) btf = bumps(16);
    const int d = VIEWS * LIGHTS * 3;
    for (int i = 0; i < 256 * d; i++) {
        const double size = exp(-2 + 0.015 * (i / d)), y = 0.3 + 0.2 * sin(i % d / 3);
        btf->values[i] = (float)(size * y * (1.5 - 0.5 * (i % 3)));
    }
    const struct lpca_options options = {1, 1, .colours = LPCA_LOG};
    g_autoptr(GError) error = NULL;
    g_autoptr(Lpca) lpca = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat(lpca->error, <, 0.02);
    g_assert_cmpfloat_with_epsilon(residual(lpca, btf), lpca->error, 1e-6);
    lpca_quantise(lpca, LPCA_8BIT_WEIGHTS);
    lpca_error(lpca, btf, 0);
    g_assert_true(lpca_write(path, lpca, &error));
    g_autoptr(Lpca) back = lpca_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(back->colours, ==, LPCA_LOG);
    g_assert_cmpfloat_with_epsilon(residual(back, btf), lpca->error, 1e-6);
}

TEST(holes) {
    float a[12], b[12], *const planes[2] = {a, b};
    for (int i = 0; i < 12; i++)
        a[i] = (float)i, b[i] = 2;
    g_assert_cmpint(btf_fill_holes(planes, 2, 4, 3), ==, 0);
    b[5] = NAN;
    g_assert_cmpint(btf_fill_holes(planes, 2, 4, 3), ==, 1);
    g_assert_cmpfloat_with_epsilon(a[5], (0 + 1 + 2 + 4 + 6 + 8 + 9 + 10) / 8.0, 1e-6);
    g_assert_cmpfloat(b[5], ==, 2);
    g_assert_cmpfloat(a[4], ==, 4);
    for (int i = 0; i < 11; i++) /* from one corner across all */
        a[i] = NAN;
    g_assert_cmpint(btf_fill_holes(planes, 2, 4, 3), ==, 11);
    for (int i = 0; i < 12; i++)
        g_assert_cmpfloat(a[i], ==, 11);
    for (int i = 0; i < 12; i++)
        a[i] = NAN;
    g_assert_cmpint(btf_fill_holes(planes, 2, 4, 3), ==, -1);
}
