#include "textons.h"

#include <float.h>
#include <string.h>

#define TEXTONS     256 /* maximum number of textons */
#define PER_TEXTON  8   /* minimum number of texels per texton, on average */
#define MEANS_STEPS 12
#define REACH       2 /* extent of a neighbourhood in each direction */
#define SIDE        (2 * REACH + 1)
/* For each candidate, this number of texels with the most similar neighbourhoods are also
 * candidates. */
#define SIMILAR 4
/* similar texels are searched in the texel's own texton, and in this number of other textons */
#define COUSINS 3
#define PASSES  3 /* number of passes over a level whose places are all filled */
#define LEVELS  4 /* maximum number of levels */
/* minimum size of the sample at the coarsest level, in texels in each dimension */
#define COARSEST 12
/* the cost of a candidate that continues no neighbour is multiplied by this */
#define JUMP 1.1F

struct texton_level {
    const struct texel_features *sample;
    int step; /* side in texels of a place (struct texton_picture): 2^level */
    int n_textons;
    guint16 *textons; /* texton of each texel of the sample */
    float *squares;   /* n_textons × n_textons: squared distances of the centres */
    float outside;    /* cost if a neighbour lies outside of the sample */
    /* number of columns and rows of the sample at which squares of step × step may begin */
    int columns, rows;
    /* for each texel, the indices of the SIMILAR most similar texels; −1 if there are fewer */
    int *similar;
};

/* The picture during its synthesis, divided into places of step × step texels. */
struct texton_picture {
    int width, height;
    int *at; /* 2 numbers per place: column and row in the sample; −1 if not filled yet */
};

static int texton_nearest(const float *centres, int n_centres, const float *value, int n) {
    int best = 0;
    float least = FLT_MAX;
    for (int k = 0; k < n_centres; k++) {
        const float square = texel_features_square(centres + (gsize)k * (gsize)n, value, n);
        if (square < least) {
            least = square;
            best = k;
        }
    }
    return best;
}

static gboolean texton_is_valid(const struct texton_level *level, int x, int y) {
    return x >= 0 && y >= 0 && x < level->columns && y < level->rows;
}

/* Chooses centres: the first at random, and each further one as the texel that is farthest from all
 * previous ones. */
static void texton_start(const struct texton_level *level, const struct texel_features *values,
                         GRand *random, float *centres) {
    const gsize n = (gsize)values->n, texels = (gsize)level->columns * (gsize)level->rows;
    g_autofree float *least = g_new(float, texels);
    gsize next = (gsize)g_rand_int_range(random, 0, (gint32)texels);
    for (gsize i = 0; i < texels; i++)
        least[i] = FLT_MAX;
    for (int k = 0; k < level->n_textons; k++) {
        const float *value =
            texel_features_at(values, (int)next % level->columns, (int)next / level->columns);
        memcpy(centres + (gsize)k * n, value, n * sizeof(float));
        next = 0;
        for (gsize i = 0; i < texels; i++) {
            const float *other =
                texel_features_at(values, (int)i % level->columns, (int)i / level->columns);
            least[i] = MIN(least[i], texel_features_square(value, other, values->n));
            next = least[i] > least[next] ? i : next;
        }
    }
}

/* Clusters the averaged features into textons by k-means. Then computes the squared distances of
 * the centres, and sets outside to the mean of these distances over pairs of texels. */
static void texton_cluster(struct texton_level *level, const struct texel_features *values,
                           GRand *random) {
    const gsize n = (gsize)values->n, textons = (gsize)level->n_textons;
    g_autofree float *centres = g_new0(float, textons *n);
    g_autofree double *sums = g_new(double, textons *n);
    g_autofree int *counts = g_new(int, textons);
    texton_start(level, values, random, centres);
    for (int step = 0; step < MEANS_STEPS; step++) {
        memset(sums, 0, sizeof(double) * textons * n);
        memset(counts, 0, sizeof(int) * textons);
        for (int y = 0; y < level->rows; y++)
            for (int x = 0; x < level->columns; x++) {
                const float *value = texel_features_at(values, x, y);
                const int k = texton_nearest(centres, level->n_textons, value, values->n);
                level->textons[(gsize)y * (gsize)values->width + (gsize)x] = (guint16)k;
                counts[k]++;
                for (gsize c = 0; c < n; c++)
                    sums[(gsize)k * n + c] += value[c];
            }
        for (gsize k = 0; k < textons; k++)
            for (gsize c = 0; c < n && counts[k] > 0; c++)
                centres[k * n + c] = (float)(sums[k * n + c] / counts[k]);
    }
    double sum = 0;
    for (gsize a = 0; a < textons; a++)
        for (gsize b = 0; b < textons; b++) {
            level->squares[a * textons + b] =
                texel_features_square(centres + a * n, centres + b * n, values->n);
            sum += (double)level->squares[a * textons + b] * counts[a] * counts[b];
        }
    const double texels = (double)level->columns * level->rows;
    level->outside = (float)(sum / (texels * texels));
}

static float texton_square(const struct texton_level *level, int x, int y, int other_x,
                           int other_y) {
    const gsize width = (gsize)level->sample->width;
    const gsize a = level->textons[(gsize)y * width + (gsize)x];
    const gsize b = level->textons[(gsize)other_y * width + (gsize)other_x];
    return level->squares[a * (gsize)level->n_textons + b];
}

/* Returns the difference between two neighbourhoods of the sample. Returns early, with a value of
 * at least `most`, when the sum has reached `most`. */
static float texton_unlike(const struct texton_level *level, const int a[2], const int b[2],
                           float most) {
    float sum = 0;
    for (int k = 0; k < SIDE * SIDE && sum < most; k++) {
        const int dx = (k % SIDE - REACH) * level->step, dy = (k / SIDE - REACH) * level->step;
        const gboolean have_a = texton_is_valid(level, a[0] + dx, a[1] + dy);
        const gboolean have_b = texton_is_valid(level, b[0] + dx, b[1] + dy);
        if (have_a && have_b)
            sum += texton_square(level, a[0] + dx, a[1] + dy, b[0] + dx, b[1] + dy);
        else if (have_a != have_b)
            sum += level->outside;
    }
    return sum;
}

/* Inserts the texel index into the list of the SIMILAR texels with the smallest differences, if its
 * difference unlike is among these. */
static void texton_insert(int *similar, float *least, int index, float unlike) {
    int at = SIMILAR;
    for (; at > 0 && unlike < least[at - 1]; at--)
        if (at < SIMILAR) {
            least[at] = least[at - 1];
            similar[at] = similar[at - 1];
        }
    if (at < SIMILAR) {
        least[at] = unlike;
        similar[at] = index;
    }
}

struct texton_search {
    const struct texton_level *level;
    const int *members; /* indices of texels in order of their texton */
    /* for each texton, the index in members at which it begins; n_textons + 1 values */
    const int *starts;
    const guint16 *near; /* for each texton, its n_near nearest textons, beginning with itself */
    int n_near;          /* COUSINS + 1, or n_textons if that is less */
};

/* Finds, for each texel of a row of the sample, the texels with the most similar neighbourhoods. */
static void texton_find_similar(int row, gpointer data) {
    const struct texton_search *search = data;
    const struct texton_level *level = search->level;
    const int width = level->sample->width;
    for (int x = 0; x < level->columns; x++) {
        const int self[2] = {x, row}, index = row * width + x;
        int *similar = level->similar + (gsize)SIMILAR * (gsize)index;
        float least[SIMILAR];
        for (int k = 0; k < SIMILAR; k++)
            least[k] = FLT_MAX;
        for (int c = 0; c < search->n_near; c++) {
            const int texton = search->near[search->n_near * level->textons[index] + c];
            for (int m = search->starts[texton]; m < search->starts[texton + 1]; m++) {
                const int other[2] = {search->members[m] % width, search->members[m] / width};
                if (ABS(other[0] - x) + ABS(other[1] - row) > level->step)
                    texton_insert(similar, least, search->members[m],
                                  texton_unlike(level, self, other, least[SIMILAR - 1]));
            }
        }
    }
}

static gboolean texton_search(struct texton_level *level, const struct work *work, GError **error) {
    const int n = level->n_textons, n_near = MIN(COUSINS + 1, n), width = level->sample->width;
    g_autofree int *starts = g_new0(int, n + 2);
    g_autofree int *members = g_new(int, (gsize)level->columns *(gsize)level->rows);
    g_autofree guint16 *near = g_new0(guint16, (gsize)n_near * (gsize)n);
    for (int y = 0; y < level->rows; y++)
        for (int x = 0; x < level->columns; x++)
            starts[level->textons[y * width + x] + 2]++;
    for (int k = 2; k < n + 2; k++)
        starts[k] += starts[k - 1];
    for (int y = 0; y < level->rows; y++)
        for (int x = 0; x < level->columns; x++)
            members[starts[level->textons[y * width + x] + 1]++] = y * width + x;
    for (int a = 0; a < n; a++)
        for (int c = 0; c < n_near; c++) {
            float least = FLT_MAX;
            for (int b = 0; b < n; b++) {
                gboolean taken = FALSE;
                for (int before = 0; before < c; before++)
                    taken = taken || near[n_near * a + before] == b;
                const float square = level->squares[(gsize)a * (gsize)n + (gsize)b];
                if (!taken && (square < least || (c == 0 && a == b))) {
                    least = c == 0 && a == b ? -1 : square;
                    near[n_near * a + c] = (guint16)b;
                }
            }
        }
    struct texton_search search = {level, members, starts, near, n_near};
    return work_parallel(work, "textons", level->rows, texton_find_similar, &search, error);
}

static float texton_cost(const struct texton_level *level, const struct texton_picture *picture,
                         int px, int py, const int s[2], float most) {
    float sum = 0;
    for (int k = 0; k < SIDE * SIDE && sum < most; k++) {
        const int dx = k % SIDE - REACH, dy = k / SIDE - REACH;
        if (dx == 0 && dy == 0)
            continue;
        const int x = (px + dx + picture->width) % picture->width;
        const int y = (py + dy + picture->height) % picture->height;
        const int *there = picture->at + 2 * ((gsize)y * (gsize)picture->width + (gsize)x);
        const int sx = s[0] + dx * level->step, sy = s[1] + dy * level->step;
        if (there[0] < 0)
            continue;
        sum += texton_is_valid(level, sx, sy) ? texton_square(level, there[0], there[1], sx, sy)
                                              : level->outside;
    }
    return sum;
}

/* Gives the candidate of a place with the least cost, or a random texel if there is no
 * candidate. */
static void texton_choose(const struct texton_level *level, const struct texton_picture *picture,
                          int px, int py, GRand *random, int ret[2]) {
    const int width = level->sample->width;
    float least = FLT_MAX;
    ret[0] = g_rand_int_range(random, 0, level->columns);
    ret[1] = g_rand_int_range(random, 0, level->rows);
    for (int k = 0; k < 9; k++) {
        const int dx = k % 3 - 1, dy = k / 3 - 1;
        const int x = (px + dx + picture->width) % picture->width;
        const int y = (py + dy + picture->height) % picture->height;
        const int *there = picture->at + 2 * ((gsize)y * (gsize)picture->width + (gsize)x);
        const int s[2] = {there[0] - dx * level->step, there[1] - dy * level->step};
        if (there[0] < 0 || !texton_is_valid(level, s[0], s[1]))
            continue;
        for (int c = -1; c < SIMILAR; c++) {
            const int index =
                c < 0 ? s[1] * width + s[0] : level->similar[SIMILAR * (s[1] * width + s[0]) + c];
            if (index < 0)
                break;
            const int candidate[2] = {index % width, index / width};
            const float factor = c < 0 ? 1 : JUMP;
            const float cost =
                factor * texton_cost(level, picture, px, py, candidate, least / factor);
            if (cost < least) {
                least = cost;
                memcpy(ret, candidate, sizeof candidate);
            }
        }
    }
}

static gboolean texton_passes(const struct texton_level *level, struct texton_picture *picture,
                              int passes, GRand *random, const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    for (int pass = 0; pass < passes; pass++)
        for (int y = 0; y < picture->height; y++) {
            if (!work_tell(work, "textons", pass * picture->height + y, passes * picture->height,
                           begun_us, error))
                return FALSE;
            for (int x = 0; x < picture->width; x++) {
                int best[2];
                texton_choose(level, picture, x, y, random, best);
                memcpy(picture->at + 2 * ((gsize)y * (gsize)picture->width + (gsize)x), best,
                       sizeof best);
            }
        }
    return TRUE;
}

/* Splits each place into four places, which together show the same texels as before. */
static void texton_refine(struct texton_picture *picture, int step) {
    const int width = 2 * picture->width, height = 2 * picture->height;
    int *at = g_new(int, 2 * (gsize)width * (gsize)height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const int *from =
                picture->at + 2 * ((gsize)(y / 2) * (gsize)picture->width + (gsize)(x / 2));
            int *to = at + 2 * ((gsize)y * (gsize)width + (gsize)x);
            to[0] = from[0] + x % 2 * step;
            to[1] = from[1] + y % 2 * step;
        }
    g_free(picture->at);
    *picture = (struct texton_picture){width, height, at};
}

static gboolean texton_level_run(const struct texel_features *features, int step, int passes,
                                 GRand *random, const struct work *work,
                                 struct texton_picture *picture, GError **error) {
    const gsize texels = (gsize)features->width * (gsize)features->height;
    g_autoptr(TexelFeatures) averaged = texel_features_averaged(features, step);
    struct texton_level level = {.sample = features,
                                 .step = step,
                                 .columns = features->width - step + 1,
                                 .rows = features->height - step + 1};
    level.n_textons = CLAMP(level.columns * level.rows / PER_TEXTON, 1, TEXTONS);
    g_autofree guint16 *textons = level.textons = g_new0(guint16, texels);
    g_autofree float *squares = level.squares =
        g_new0(float, (gsize)level.n_textons *(gsize)level.n_textons);
    g_autofree int *similar = level.similar = g_new(int, SIMILAR *texels);
    memset(similar, 0xff, sizeof(int) * SIMILAR * texels);
    texton_cluster(&level, averaged, random);
    return texton_search(&level, work, error) &&
           texton_passes(&level, picture, passes, random, work, error);
}

gboolean textons_synthesize(const struct texel_features *features, guint32 seed,
                            const struct work *work, struct index_map *map, GError **error) {
    int n_levels = 1;
    while (n_levels < LEVELS && map->width % (1 << n_levels) == 0 &&
           map->height % (1 << n_levels) == 0 && map->width >> n_levels >= SIDE &&
           map->height >> n_levels >= SIDE &&
           MIN(features->width, features->height) >> n_levels >= COARSEST)
        n_levels++;
    struct texton_picture picture = {map->width >> (n_levels - 1), map->height >> (n_levels - 1),
                                     NULL};
    const gsize places = 2 * (gsize)picture.width * (gsize)picture.height;
    picture.at = g_new(int, places);
    memset(picture.at, 0xff, sizeof(int) * places);
    GRand *random = g_rand_new_with_seed(seed);
    gboolean good = TRUE;
    for (int k = n_levels - 1; good && k >= 0; k--) {
        /* The coarsest level gets one more pass, because its first pass fills the picture. */
        good = texton_level_run(features, 1 << k, k == n_levels - 1 ? PASSES + 1 : PASSES, random,
                                work, &picture, error);
        if (k > 0)
            texton_refine(&picture, 1 << (k - 1));
    }
    for (gsize i = 0; good && i < 2 * (gsize)map->width * (gsize)map->height; i++)
        map->levels[0][i] = (guint16)picture.at[i];
    g_rand_free(random);
    g_free(picture.at);
    return good;
}
