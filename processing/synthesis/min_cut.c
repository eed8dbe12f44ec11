#include "min_cut.h"

#include <float.h>
#include <string.h>

struct min_cut {
    const float *costs, *turns;
    int length, width;
    float *sums; /* length × width: cost of the cheapest path from the first row to each place */
    /* For each place, the offset (−1, 0 or +1) from its column to the column of the previous row
     * from which the cheapest path comes. */
    gint8 *before;
};

static float min_cut_step(const struct min_cut *c, int row, int from, int to) {
    if (from == to || !c->turns)
        return 0;
    return c->turns[2 * ((gsize)row * (gsize)c->width + (gsize)from) + (to > from ? 1 : 0)];
}

/* Computes the costs of the paths that begin at the column `begin` of the first row. If begin is
 * −1, the paths may begin at any column. */
static void min_cut_sums(const struct min_cut *c, int begin) {
    const gsize width = (gsize)c->width;
    for (int i = 0; i < c->width; i++)
        c->sums[i] = begin < 0 || begin == i ? c->costs[i] : FLT_MAX;
    for (int row = 1; row < c->length; row++)
        for (int i = 0; i < c->width; i++) {
            const float *last = c->sums + (gsize)(row - 1) * width;
            float least = FLT_MAX;
            int best = 0;
            for (int d = -1; d <= 1; d++) {
                const int from = i + d;
                if (from < 0 || from >= c->width || last[from] == FLT_MAX)
                    continue;
                const float sum = last[from] + min_cut_step(c, row - 1, from, i);
                if (sum < least) {
                    least = sum;
                    best = d;
                }
            }
            c->sums[(gsize)row * width + (gsize)i] =
                least < FLT_MAX ? least + c->costs[(gsize)row * width + (gsize)i] : FLT_MAX;
            c->before[(gsize)row * width + (gsize)i] = (gint8)best;
        }
}

/* Returns the minimum cost of a path, and gives the column at which this path ends. With begin ≥ 0,
 * the path begins at this column and is closed. */
static float min_cut_end(const struct min_cut *c, int begin, int *ret_end) {
    const float *last = c->sums + (gsize)(c->length - 1) * (gsize)c->width;
    float least = FLT_MAX;
    for (int i = 0; i < c->width; i++) {
        if ((begin >= 0 && ABS(i - begin) > 1) || last[i] == FLT_MAX)
            continue;
        const float sum = last[i] + (begin >= 0 ? min_cut_step(c, c->length - 1, i, begin) : 0);
        if (sum < least) {
            least = sum;
            *ret_end = i;
        }
    }
    return least;
}

float min_cut(const float *costs, const float *turns, int length, int width, gboolean cyclic,
              int *ret_path) {
    const gsize n = (gsize)length * (gsize)width;
    g_autofree float *sums = g_new(float, n);
    g_autofree gint8 *before = g_new0(gint8, n);
    const struct min_cut c = {costs, turns, length, width, sums, before};
    float least = FLT_MAX;
    for (int begin = cyclic ? 0 : -1; begin < (cyclic ? width : 0); begin++) {
        int end = 0;
        min_cut_sums(&c, begin);
        const float cost = min_cut_end(&c, begin, &end);
        if (cost >= least)
            continue;
        least = cost;
        for (int row = length - 1; row >= 0; row--) {
            ret_path[row] = end;
            end += before[(gsize)row * (gsize)width + (gsize)end];
        }
    }
    return least;
}
