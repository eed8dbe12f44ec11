#include "quilting.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "min_cut.h"
#include "order.h"

/* A block is drawn at random from those whose error is at most 1 + TOLERANCE times the minimum
 * error. */
#define TOLERANCE 0.1F
/* maximum number of texels of an overlap that are compared for the choice of a block */
#define COMPARED 600
#define OVERLAPS 4 /* ratio of a block's side to the width of its overlap */
#define LEAST    8 /* minimum number of texels of a block in each dimension */

struct quilt {
    const struct texel_features *sample;
    struct index_map *map;
    guint8 *filled; /* whether each texel of the map is filled */
    int block;
    int column, row; /* position of the block's first texel in the map */
    /* The texels of the block that are already filled, by which the block is chosen. */
    int n_compared;
    int *compared;     /* n_compared × 2: column and row in the block */
    float *wanted;     /* features of these texels: n_compared × sample->n */
    int columns, rows; /* number of columns and rows of the sample at which a block may begin */
    float *errors;     /* rows × columns: error of the block of the sample that begins there */
};

int quilting_block(const struct texel_features *features) {
    const int side = MIN(features->width, features->height);
    const int period = order_period(features);
    const int block = period > 0 ? (3 * period + 1) / 2 : 3 * side / 8;
    return MAX(CLAMP(block, side / 4, side / 2), MIN(LEAST, side));
}

static gsize quilt_at(const struct quilt *quilt, int x, int y) {
    const int width = quilt->map->width, height = quilt->map->height;
    return (gsize)((quilt->row + y) % height) * (gsize)width + (gsize)((quilt->column + x) % width);
}

/* Returns the features of the map at a texel of the block. */
static const float *quilt_there(const struct quilt *quilt, int x, int y) {
    const guint16 *s = quilt->map->levels[0] + 2 * quilt_at(quilt, x, y);
    return texel_features_at(quilt->sample, s[0], s[1]);
}

/* Computes the errors of all blocks of the sample whose first texel is in a row of the sample. */
static void quilt_compare_row(int row, gpointer data) {
    const struct quilt *quilt = data;
    const int n = quilt->sample->n;
    for (int column = 0; column < quilt->columns; column++) {
        float sum = 0;
        for (int k = 0; k < quilt->n_compared; k++)
            sum += texel_features_square(texel_features_at(quilt->sample,
                                                           column + quilt->compared[2 * k],
                                                           row + quilt->compared[2 * k + 1]),
                                         quilt->wanted + (gsize)n * (gsize)k, n);
        quilt->errors[(gsize)row * (gsize)quilt->columns + (gsize)column] = sum;
    }
}

/* Sets n_compared, compared and wanted. Gathers the texels of the block that are already filled. If
 * there are many, only every step-th of them is taken, about COMPARED in all. */
static void quilt_gather(struct quilt *quilt) {
    const int n = quilt->sample->n;
    int n_filled = 0;
    for (int k = 0; k < quilt->block * quilt->block; k++)
        n_filled += quilt->filled[quilt_at(quilt, k % quilt->block, k / quilt->block)];
    /* An odd step reaches all columns and rows, except if it divides the side of the block. */
    int step = MAX(1, n_filled / COMPARED) | 1, seen = 0;
    quilt->n_compared = 0;
    for (int k = 0; k < quilt->block * quilt->block; k++) {
        const int x = k % quilt->block, y = k / quilt->block;
        if (!quilt->filled[quilt_at(quilt, x, y)] || seen++ % step != 0)
            continue;
        quilt->compared[2 * quilt->n_compared] = x;
        quilt->compared[2 * quilt->n_compared + 1] = y;
        memcpy(quilt->wanted + (gsize)n * (gsize)quilt->n_compared, quilt_there(quilt, x, y),
               (gsize)n * sizeof(float));
        quilt->n_compared++;
    }
}

/* Draws one of the blocks that fit. ret receives its first texel in the sample. Returns FALSE when
 * cancelled. */
static gboolean quilt_choose(struct quilt *quilt, GRand *random, const struct work *work,
                             int ret[2], GError **error) {
    const int n = quilt->columns * quilt->rows;
    const struct work silent = {.n_threads = work ? work->n_threads : 0,
                                .cancellable = work ? work->cancellable : NULL};
    float least = FLT_MAX;
    int fit = 0;
    quilt_gather(quilt);
    if (!work_parallel(&silent, "quilting", quilt->rows, quilt_compare_row, quilt, error))
        return FALSE;
    for (int k = 0; k < n; k++)
        least = MIN(least, quilt->errors[k]);
    for (int k = 0; k < n; k++)
        fit += quilt->errors[k] <= least * (1 + TOLERANCE);
    int drawn = g_rand_int_range(random, 0, fit);
    for (int k = 0; k < n; k++)
        if (quilt->errors[k] <= least * (1 + TOLERANCE) && drawn-- == 0) {
            ret[0] = k % quilt->columns;
            ret[1] = k / quilt->columns;
        }
    return TRUE;
}

/* The sides of a block. Each side may have a strip that overlaps texels that are already filled.
 * The width of the strip is 0 if there is no overlap. */
enum quilt_side { QUILT_LEFT, QUILT_TOP, QUILT_RIGHT, QUILT_BOTTOM, QUILT_SIDES };

/* Gives the texel of a block that is at the position along on a side, and inwards texels away from
 * this side. */
static void quilt_of_side(const struct quilt *quilt, enum quilt_side side, int along, int inwards,
                          int ret[2]) {
    const int from =
        side == QUILT_RIGHT || side == QUILT_BOTTOM ? quilt->block - 1 - inwards : inwards;
    ret[side == QUILT_LEFT || side == QUILT_RIGHT ? 0 : 1] = from;
    ret[side == QUILT_LEFT || side == QUILT_RIGHT ? 1 : 0] = along;
}

/* Finds the boundary of a block on a side: for each texel along the side, ret_path receives how far
 * inwards the block begins. The boundary is the path of least error. */
static void quilt_cut(const struct quilt *quilt, enum quilt_side side, int wide, const int from[2],
                      int *ret_path) {
    const gsize n = (gsize)wide;
    g_autofree float *errors = g_new(float, n *(gsize)quilt->block);
    for (int along = 0; along < quilt->block; along++)
        for (int inwards = 0; inwards < wide; inwards++) {
            int at[2];
            quilt_of_side(quilt, side, along, inwards, at);
            errors[(gsize)along * n + (gsize)inwards] =
                quilt->filled[quilt_at(quilt, at[0], at[1])]
                    ? texel_features_square(
                          quilt_there(quilt, at[0], at[1]),
                          texel_features_at(quilt->sample, from[0] + at[0], from[1] + at[1]),
                          quilt->sample->n)
                    : 0;
        }
    min_cut(errors, NULL, quilt->block, wide, FALSE, ret_path);
}

static void quilt_lay(struct quilt *quilt, const int wide[QUILT_SIDES], const int from[2]) {
    const int block = quilt->block;
    g_autofree int *paths = g_new0(int, (gsize)QUILT_SIDES *(gsize)block);
    g_autofree guint8 *kept = g_new0(guint8, (gsize)block * (gsize)block);
    for (int side = 0; side < QUILT_SIDES; side++)
        if (wide[side] > 0)
            quilt_cut(quilt, (enum quilt_side)side, wide[side], from, paths + side * block);
    for (int side = 0; side < QUILT_SIDES; side++)
        for (int along = 0; along < block; along++)
            for (int inwards = 0; wide[side] > 0 && inwards < paths[side * block + along];
                 inwards++) {
                int at[2];
                quilt_of_side(quilt, (enum quilt_side)side, along, inwards, at);
                kept[at[1] * block + at[0]] = 1;
            }
    for (int y = 0; y < block; y++)
        for (int x = 0; x < block; x++) {
            const gsize at = quilt_at(quilt, x, y);
            if (kept[y * block + x] && quilt->filled[at])
                continue;
            quilt->map->levels[0][2 * at] = (guint16)(from[0] + x);
            quilt->map->levels[0][2 * at + 1] = (guint16)(from[1] + y);
            quilt->filled[at] = 1;
        }
}

/* Returns the position at which the k-th of n blocks begins. */
static int quilt_begin(int size, int k, int n) {
    return (int)((gint64)size * k / n);
}

/* Returns the number of texels by which the k-th block overlaps the next block. After the last
 * block comes the first. */
static int quilt_overlap(int size, int k, int n, int block) {
    return MAX(0, quilt_begin(size, k, n) + block - quilt_begin(size, k + 1, n));
}

static gboolean quilt_all(struct quilt *quilt, GRand *random, const struct work *work,
                          GError **error) {
    const int width = quilt->map->width, height = quilt->map->height;
    const int step = quilt->block - MAX(1, quilt->block / OVERLAPS);
    const int across = (width + step - 1) / step, down = (height + step - 1) / step;
    const gint64 begun_us = g_get_monotonic_time();
    for (int j = 0; j < down; j++)
        for (int i = 0; i < across; i++) {
            if (!work_tell(work, "quilting", j * across + i, across * down, begun_us, error))
                return FALSE;
            quilt->column = quilt_begin(width, i, across);
            quilt->row = quilt_begin(height, j, down);
            const int wide[QUILT_SIDES] = {
                i > 0 ? quilt_overlap(width, i - 1, across, quilt->block) : 0,
                j > 0 ? quilt_overlap(height, j - 1, down, quilt->block) : 0,
                i == across - 1 && i > 0 ? quilt_overlap(width, i, across, quilt->block) : 0,
                j == down - 1 && j > 0 ? quilt_overlap(height, j, down, quilt->block) : 0};
            int from[2] = {0, 0};
            if (!quilt_choose(quilt, random, work, from, error))
                return FALSE;
            quilt_lay(quilt, wide, from);
        }
    return TRUE;
}

gboolean quilting_synthesize(const struct texel_features *features, int block, guint32 seed,
                             const struct work *work, struct index_map *map, GError **error) {
    const gsize texels = (gsize)map->width * (gsize)map->height;
    block = MIN(MIN(block, MIN(map->width, map->height)), MIN(features->width, features->height));
    const gsize of_block = (gsize)block * (gsize)block;
    struct quilt quilt = {.sample = features,
                          .map = map,
                          .filled = g_new0(guint8, texels),
                          .block = block,
                          .compared = g_new(int, 2 * of_block),
                          .wanted = g_new(float, (gsize)features->n *of_block),
                          .columns = features->width - block + 1,
                          .rows = features->height - block + 1};
    quilt.errors = g_new0(float, (gsize)quilt.columns *(gsize)quilt.rows);
    GRand *random = g_rand_new_with_seed(seed);
    const gboolean good = quilt_all(&quilt, random, work, error);
    g_rand_free(random);
    g_free(quilt.filled);
    g_free(quilt.compared);
    g_free(quilt.wanted);
    g_free(quilt.errors);
    return good;
}
