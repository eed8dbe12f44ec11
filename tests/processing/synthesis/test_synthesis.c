/* Synthesis from samples whose correct continuation is known, because they are cut from periodic
 * patterns. */
#include "lib/btf_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "synthesis/quilting.h"
#include "synthesis/synthesis.h"
#include "synthesis/tileable.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

/* A pattern of sines with these periods in texels, another one for each view, light and colour.
 * noise: as much of another value at each texel. */
static struct btf_matrix *new_pattern(int width, int height, int period_x, int period_y,
                                      double noise) {
    struct btf_matrix *btf = btf_fixture_new("pattern", width, height, 5, 4);
    const gsize values = btf_layout_values(&btf->layout);
    GRand *random = g_rand_new_with_seed(7);
    for (gsize k = 0; k < values; k++) {
        const double a = g_rand_double_range(random, 0, 6.28);
        const double b = g_rand_double_range(random, 0, 6.28);
        for (int i = 0; i < width * height; i++) {
            const int row = i / width, column = i % width;
            const double x = 2 * G_PI * column / period_x, y = 2 * G_PI * row / period_y;
            btf->values[(gsize)i * values + k] =
                (float)(1 + 0.3 * sin(x + a) + 0.3 * sin(y + b) + 0.2 * sin(x + 2 * y + a - b) +
                        noise * g_rand_double_range(random, -1, 1));
        }
    }
    g_rand_free(random);
    return btf;
}

static struct texel_features *features_of(const struct btf_matrix *btf,
                                          const struct mdf_table *mdf) {
    struct texel_features *features = ok(texel_features_compute(btf, mdf, NULL, ERR));
    return features;
}

static const float *row_of(const struct btf_matrix *btf, const struct index_map *map, int x,
                           int y) {
    const guint16 *s = map->levels[0] + 2 * ((y % map->height) * map->width + x % map->width);
    return btf->values + ((gsize)s[1] * btf->layout.width + s[0]) * btf_layout_values(&btf->layout);
}

/* RMS difference of the values of a map's texel from those a period to the right and below. */
static double break_of_period(const struct btf_matrix *btf, const struct index_map *map, int right,
                              int down) {
    const gsize values = btf_layout_values(&btf->layout);
    double squares = 0;
    for (int i = 0; i < map->width * map->height; i++) {
        const float *a = row_of(btf, map, i % map->width, i / map->width);
        const float *b = row_of(btf, map, i % map->width + right, i / map->width + down);
        for (gsize k = 0; k < values; k++)
            squares += (a[k] - b[k]) * (a[k] - b[k]) / values;
    }
    return sqrt(squares / (map->width * map->height));
}

/* Distances of features are those of the whole rows. */
TEST(features) {
    g_autoptr(BtfMatrix) btf = new_pattern(24, 20, 12, 9, 0);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    const gsize values = btf_layout_values(&btf->layout);
    g_assert_cmpfloat(features->explained, >, 0.999);
    g_assert_cmpfloat(features->relief, ==, 0);
    for (int i = 0; i < 24 * 20; i += 37)
        for (int j = 0; j < 24 * 20; j += 23) {
            double square = 0;
            for (gsize k = 0; k < values; k++)
                square += pow(btf->values[i * values + k] - btf->values[j * values + k], 2);
            g_assert_cmpfloat_with_epsilon(
                texel_features_square(texel_features_at(features, i % 24, i / 24),
                                      texel_features_at(features, j % 24, j / 24), features->n),
                square, 1e-3 + 1e-3 * square);
        }
}

static struct index_map *synthesize(const struct texel_features *features,
                                    enum synthesis_method method, int width, int height,
                                    guint32 seed, const struct work *work,
                                    struct synthesis_result *result) {
    const struct synthesis_options options = {method, width, height, 0, seed};
    struct index_map *map = ok(synthesis_of_features(features, &options, work, result, ERR));
    return map;
}

/* A period that must be kept, across blocks and where the map itself repeats. */
TEST(period) {
    g_autoptr(BtfMatrix) btf = new_pattern(40, 36, 8, 6, 0);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_assert_cmpint(order_period(features), ==, 8);
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_QUILTING, 96, 66, 3, NULL, &result);
    g_assert_cmpfloat(break_of_period(btf, map, 8, 0), <, 1e-5);
    g_assert_cmpfloat(break_of_period(btf, map, 0, 6), <, 1e-5);
    g_assert_cmpfloat(break_of_period(btf, map, 4, 0), >, 0.1); /* the measure can tell */
    g_assert_cmpfloat(result.order[SYNTHESIS_QUILTING], <, 0.02);
    /* It is no copy: neighbours in the map come from different parts of the sample. */
    g_assert_cmpint(result.seams.seams, >, 100);
    g_assert_cmpfloat(result.seams.seam, <, 1.05 * result.seams.inside);
}

/* Cut so that repeating it shows a seam: the part that is left repeats as the pattern does. */
TEST(seam) {
    g_autoptr(BtfMatrix) btf = new_pattern(40, 42, 23, 17, 0);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_assert_cmpint(map->width, ==, 23);
    g_assert_cmpint(map->height, ==, 34);
    g_assert_cmpfloat(result.seams.seam, <=, result.seams.inside);
    for (int y = 0; y < map->height; y++)
        for (int x = 0; x < map->width; x++) {
            const float *a = row_of(btf, map, x, y);
            const guint16 *origin = map->levels[0];
            const gsize there = (gsize)((origin[1] + y) % 17) * 40 + (origin[0] + x) % 23;
            for (gsize k = 0; k < btf_layout_values(&btf->layout); k++)
                g_assert_cmpfloat_with_epsilon(
                    a[k], btf->values[there * btf_layout_values(&btf->layout) + k], 1e-5);
        }
}

/* With noise nothing fits exactly, and the seam still differs no more than neighbours do. */
TEST(noisy_seam) {
    g_autoptr(BtfMatrix) btf = new_pattern(40, 42, 23, 17, 0.15);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_assert_cmpint(map->width, ==, 23);
    g_assert_cmpint(map->height % 17, ==, 0);
    g_assert_cmpint(result.seams.seams, >, 0);
    g_assert_cmpfloat(result.seams.seam, <=, result.seams.inside);
}

/* What only the relief shows counts as well: colours repeat every 9 texels, heights every 18. */
TEST(relief) {
    g_autoptr(BtfMatrix) btf = new_pattern(40, 40, 9, 9, 0);
    const float angles[2] = {0, 45};
    g_autoptr(MdfTable) mdf = mdf_table_new(40, 40, 2, btf->layout.texel_mm, angles, angles);
    for (int i = 0; i < 2 * 40 * 40; i++)
        mdf->depth_mm[i] = (float)(btf->layout.texel_mm * (3 + sin(2 * G_PI * (i % 40) / 18)));
    g_autoptr(TexelFeatures) plain = features_of(btf, NULL), both = features_of(btf, mdf);
    struct synthesis_result result;
    g_autoptr(IndexMap) flat = synthesize(plain, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_assert_cmpfloat(result.relief, ==, 0);
    g_autoptr(IndexMap) high = synthesize(both, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_assert_cmpfloat(result.relief, >, 0.2);
    g_assert_cmpint(flat->width, ==, 36);
    g_assert_cmpint(high->width, ==, 36);
    /* Where 36 does not fit, the next is 27 by colours, and 18 with the relief. */
    g_autoptr(BtfMatrix) less = new_pattern(34, 40, 9, 9, 0);
    g_autoptr(MdfTable) lower = mdf_table_new(34, 40, 2, btf->layout.texel_mm, angles, angles);
    for (int i = 0; i < 2 * 34 * 40; i++)
        lower->depth_mm[i] = (float)(btf->layout.texel_mm * (3 + sin(2 * G_PI * (i % 34) / 18)));
    g_autoptr(TexelFeatures) less_plain = features_of(less, NULL);
    g_autoptr(TexelFeatures) less_both = features_of(less, lower);
    g_autoptr(IndexMap) less_flat =
        synthesize(less_plain, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_autoptr(IndexMap) less_high =
        synthesize(less_both, SYNTHESIS_TILEABLE, 0, 0, 0, NULL, &result);
    g_assert_cmpint(less_flat->width, ==, 27);
    g_assert_cmpint(less_high->width, ==, 18);
}

static void assert_same_maps(const struct index_map *a, const struct index_map *b) {
    g_assert_cmpint(a->n_levels, ==, b->n_levels);
    for (int k = 0; k < a->n_levels; k++) {
        const gsize bytes = 2 * sizeof(guint16) * (gsize)index_map_size(a->width, k) *
                            (gsize)index_map_size(a->height, k);
        g_assert_cmpmem(a->levels[k], bytes, b->levels[k], bytes);
    }
}

/* The same seed gives the same map, with any number of threads; another one another. */
TEST(seeds) {
    g_autoptr(BtfMatrix) btf = new_pattern(32, 28, 11, 13, 0.4);
    const struct work one = {.n_threads = 1}, four = {.n_threads = 4};
    for (int method = SYNTHESIS_AUTO; method <= SYNTHESIS_QUILTING; method++) {
        struct synthesis_result results[3];
        struct index_map *maps[3];
        for (int k = 0; k < 3; k++) {
            g_autoptr(GError) error = NULL;
            g_autoptr(TexelFeatures) features =
                texel_features_compute(btf, NULL, k == 0 ? &one : &four, &error);
            g_assert_no_error(error);
            maps[k] = synthesize(features, (enum synthesis_method)method, 48, 40, k == 2 ? 8 : 5,
                                 k == 0 ? &one : &four, &results[k]);
        }
        assert_same_maps(maps[0], maps[1]);
        g_assert_cmpint(memcmp(maps[0]->levels[0], maps[2]->levels[0], 4 * 48 * 40), !=, 0);
        if (method == SYNTHESIS_AUTO) {
            const double *order = results[0].order;
            g_assert_cmpint(results[0].method, ==,
                            order[SYNTHESIS_TEXTONS] - SYNTHESIS_SPARE <= order[SYNTHESIS_QUILTING]
                                ? SYNTHESIS_TEXTONS
                                : SYNTHESIS_QUILTING);
        }
        for (int k = 0; k < 3; k++)
            index_map_free(maps[k]);
    }
}

/* Textons lose an order of long range, quilting keeps it, and auto sees that. */
TEST(auto) {
    g_autoptr(BtfMatrix) btf = new_pattern(48, 48, 16, 16, 0.3);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_AUTO, 96, 96, 1, NULL, &result);
    g_assert_cmpint(result.method, ==, SYNTHESIS_QUILTING);
    g_assert_cmpstr(map->method, ==, "quilting");
    g_assert_cmpfloat(result.order[SYNTHESIS_QUILTING], <, result.order[SYNTHESIS_TEXTONS]);
}

/* Most texels of a map of textons continue their neighbours, and those at seams fit. */
TEST(textons) {
    g_autoptr(BtfMatrix) btf = new_pattern(40, 36, 8, 6, 0);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_TEXTONS, 96, 72, 3, NULL, &result);
    g_assert_cmpfloat(result.seams.seam, <, 1.5 * result.seams.inside);
    g_assert_cmpint(result.seams.seams, <, result.seams.pairs / 3);
}

/* A block of a level looks like what stands there. */
TEST(levels) {
    g_autoptr(BtfMatrix) btf = new_pattern(48, 45, 20, 23, 0);
    g_autoptr(TexelFeatures) features = features_of(btf, NULL);
    struct synthesis_result result;
    g_autoptr(IndexMap) map = synthesize(features, SYNTHESIS_QUILTING, 61, 69, 3, NULL, &result);
    g_assert_cmpint(map->n_levels, ==, 4);
    for (int level = 1; level < map->n_levels; level++) {
        const int side = 1 << level, width = index_map_size(map->width, level);
        double squares = 0, all = 0;
        for (int y = 0; y + side <= map->height; y += side)
            for (int x = 0; x + side <= map->width; x += side) {
                const guint16 *s = map->levels[level] + 2 * (y / side * width + x / side);
                g_assert_cmpint(s[0], <=, map->sample_width - side);
                g_assert_cmpint(s[1], <=, map->sample_height - side);
                for (int c = 0; c < features->n; c++) {
                    double there = 0, taken = 0;
                    for (int k = 0; k < side * side; k++) {
                        const guint16 *one =
                            map->levels[0] + 2 * ((y + k / side) * map->width + x + k % side);
                        there += texel_features_at(features, one[0], one[1])[c];
                        taken += texel_features_at(features, s[0] + k % side, s[1] + k / side)[c];
                    }
                    squares += (there - taken) * (there - taken);
                    all += there * there;
                }
            }
        g_test_message("level %d: %.4f", level, squares / all);
        g_assert_cmpfloat(squares, <, 0.1 * all);
    }
}

static struct index_map *read_back(const struct index_map *map, GError **error) {
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "index.exr", NULL);
    g_autoptr(GError) local = NULL;
    g_assert_true(index_map_write(path, map, &local));
    struct index_map *read = index_map_read(path, error);
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    return read;
}

TEST(file) {
    g_autoptr(GError) error = NULL;
    g_autoptr(IndexMap) map = index_map_new(7, 5, 300, 200, 0.25, "textons");
    for (int i = 0; i < 35; i++) {
        map->levels[0][2 * i] = (guint16)(299 - i);
        map->levels[0][2 * i + 1] = (guint16)(5 * i);
    }
    map->levels[1] = g_new0(guint16, 2 * 4 * 3);
    map->levels[1][23] = 199;
    map->n_levels = 2;
    g_autoptr(IndexMap) read = read_back(map, &error);
    g_assert_no_error(error);
    assert_same_maps(map, read);
    g_assert_cmpint(read->sample_width, ==, 300);
    g_assert_cmpint(read->sample_height, ==, 200);
    g_assert_cmpfloat(read->texel_mm, ==, 0.25);
    g_assert_cmpstr(read->method, ==, "textons");
    map->levels[1][23] = 200; /* a row that the sample does not have */
    g_assert_null(read_back(map, &error));
    g_assert_error(error, EXR_ERROR, EXR_ERROR_FORMAT);
    g_assert_nonnull(
        strstr(error->message, "refers to row 200, but the sample has the rows 0 to 199"));
    g_clear_error(&error);
    g_autoptr(IndexMap) huge = index_map_new(7, 5, 1 << 20, 200, 0.25, "textons");
    g_assert_null(read_back(huge, &error));
    g_assert_error(error, EXR_ERROR, EXR_ERROR_FORMAT);
}
