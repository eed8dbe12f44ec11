#include "tileable.h"

#include <float.h>
#include <string.h>

#include "min_cut.h"

#define SPARE        1.1F
#define SPARE_INSIDE 0.01F /* tolerated mismatch, relative to inside() */
/* a side of the sample is at least this many times as wide as its overlap */
#define OVERLAP 4
#define LEAST   3 /* minimum number of texels of an overlap */

/* The texels of the sample, in rows along the seam. places[2 (across × length + along)] and the
 * following number are the column and row of the texel at (along, across). */
struct tileable {
    const struct texel_features *features;
    const guint16 *places;
    /* length: number of texels along the seam
     * across: number of texels across the seam; the period is a part of these */
    int length, across;
    gboolean cyclic;
};

struct tileable_cut {
    int period, overlap;
    /* for each of the length texels along the seam, the number of columns of the overlap that show
     * the end of the sample: 1 … overlap − 1 */
    int *path;
};

static const guint16 *place(const struct tileable *t, int across, int along) {
    return t->places + 2 * ((gsize)across * (gsize)t->length + (gsize)along);
}

/* Returns the squared distance of the features at two places. */
static float square(const struct tileable *t, int across, int along, int other_across,
                    int other_along) {
    const guint16 *a = place(t, across, along);
    const guint16 *b = place(t, other_across, other_along);
    return texel_features_square(texel_features_at(t->features, a[0], a[1]),
                                 texel_features_at(t->features, b[0], b[1]), t->features->n);
}

/* The sample and its copy one period later are two pictures that overlap. Returns the mean squared
 * distance between the two pictures in the two columns next to a cut before column c. */
static float mismatch(const struct tileable *t, int period, int c, int along) {
    return 0.5F * (square(t, c - 1 + period, along, c - 1, along) +
                   square(t, c + period, along, c, along));
}

/* Returns the cost of a cut before column c. Before the cut, the end of the sample is shown, and
 * after it, the beginning. */
static float cut_cost(const struct tileable *t, int period, int c, int along) {
    return square(t, c - 1 + period, along, c, along) + mismatch(t, period, c, along);
}

/* Finds the path of the least cost for a period and an overlap. Returns the mean mismatch along the
 * path. */
static float cut_at(const struct tileable *t, int period, int overlap, int *ret_path) {
    const int width = overlap - 1;
    const gsize n = (gsize)width * (gsize)t->length;
    g_autofree float *costs = g_new(float, n), *turns = g_new0(float, 2 * n);
    for (int along = 0; along < t->length; along++)
        for (int k = 0; k < width; k++) {
            const gsize at = (gsize)along * (gsize)width + (gsize)k;
            const int c = k + 1, next = (along + 1) % t->length;
            costs[at] = cut_cost(t, period, c, along);
            if (along + 1 == t->length && !t->cyclic)
                continue;
            turns[2 * at] = square(t, c - 1 + period, along, c - 1, next);
            turns[2 * at + 1] = square(t, c, along, c + period, next);
        }
    min_cut(costs, turns, t->length, width, t->cyclic, ret_path);
    float sum = 0;
    for (int along = 0; along < t->length; along++)
        sum += mismatch(t, period, ++ret_path[along], along);
    return sum / (float)t->length;
}

/* Returns the mean squared distance of the features of texels that are neighbours across the seam's
 * direction. The mean is over the whole sample. */
static float inside(const struct tileable *t) {
    double sum = 0;
    for (int across = 0; across + 1 < t->across; across++)
        for (int along = 0; along < t->length; along++)
            sum += square(t, across, along, across + 1, along);
    return (float)(sum / ((double)(t->across - 1) * t->length));
}

/* Chooses the period as tileable.h says, and finds its path. */
static struct tileable_cut choose(const struct tileable *t) {
    const int first = (t->across + 1) / 2, last = t->across - LEAST;
    g_autofree float *costs = g_new0(float, last - first + 1);
    const float spare = SPARE_INSIDE * inside(t);
    struct tileable_cut cut = {.path = g_new0(int, t->length)};
    float least = FLT_MAX;
    for (int period = first; period <= last; period++) {
        const int overlap = MIN(t->across - period, MAX(LEAST, t->across / OVERLAP));
        costs[period - first] = cut_at(t, period, overlap, cut.path);
        least = MIN(least, costs[period - first]);
    }
    cut.period = last;
    while (costs[cut.period - first] > SPARE * least + spare)
        cut.period--;
    cut.overlap = MIN(t->across - cut.period, MAX(LEAST, t->across / OVERLAP));
    cut_at(t, cut.period, cut.overlap, cut.path);
    return cut;
}

/* Returns one period of places: cut->period × length, in the order of t->places; g_free(). */
static guint16 *lay(const struct tileable *t, const struct tileable_cut *cut) {
    guint16 *to = g_new0(guint16, 2 * (gsize)cut->period * (gsize)t->length);
    for (int across = 0; across < cut->period; across++)
        for (int along = 0; along < t->length; along++) {
            const int from = across < cut->path[along] ? across + cut->period : across;
            memcpy(to + 2 * ((gsize)across * (gsize)t->length + (gsize)along),
                   place(t, from, along), 2 * sizeof(guint16));
        }
    return to;
}

struct index_map *tileable_make(const struct texel_features *features) {
    const gsize width = (gsize)features->width, height = (gsize)features->height;
    g_autofree guint16 *all = g_new0(guint16, 2 * width * height);
    for (gsize x = 0; x < width; x++)
        for (gsize y = 0; y < height; y++) {
            all[2 * (x * height + y)] = (guint16)x;
            all[2 * (x * height + y) + 1] = (guint16)y;
        }
    /* Left and right edges: the seam is vertical. */
    const struct tileable sides = {features, all, (int)height, (int)width, FALSE};
    const struct tileable_cut down = choose(&sides);
    g_autofree guint16 *cut_down = lay(&sides, &down);
    /* Upper and lower edges: the seam runs along the rows of the part that was cut out above. The
     * two ends of the seam meet, because the left and right edges now join. */
    g_autofree guint16 *rows = g_new0(guint16, 2 * (gsize)down.period * height);
    for (gsize x = 0; x < (gsize)down.period; x++)
        for (gsize y = 0; y < height; y++)
            memcpy(rows + 2 * (y * (gsize)down.period + x), cut_down + 2 * (x * height + y),
                   2 * sizeof(guint16));
    const struct tileable ends = {features, rows, down.period, (int)height, TRUE};
    const struct tileable_cut along = choose(&ends);
    g_autofree guint16 *cut_along = lay(&ends, &along);
    struct index_map *map = index_map_new(down.period, along.period, features->width,
                                          features->height, features->texel_mm, "tileable");
    memcpy(map->levels[0], cut_along, 2 * sizeof(guint16) * (gsize)map->width * (gsize)map->height);
    g_free(down.path);
    g_free(along.path);
    return map;
}
