#include "order.h"

#include <math.h>

#define MIN_PEAK 0.3
#define MIN_RISE 0.1
#define MIN_LAG  3    /* minimum lag in texels */
#define DRAWN    2048 /* number of places of a map that are examined */
#define SEED     0x6f726465u

struct order_sums {
    double product, first, second;
};

static void add(struct order_sums *sums, const float *a, const float *b, int n) {
    for (int k = 0; k < n; k++) {
        sums->product += (double)a[k] * b[k];
        sums->first += (double)a[k] * a[k];
        sums->second += (double)b[k] * b[k];
    }
}

static double order_of(const struct order_sums *sums) {
    const double scale = sqrt(sums->first * sums->second);
    return scale > 0 ? sums->product / scale : 0;
}

/* Returns the autocorrelation ρ (order.h) of the sample at the lag (dx, dy), dy ≥ 0. */
static double sample(const struct texel_features *f, int dx, int dy) {
    struct order_sums sums = {0};
    for (int y = 0; y + dy < f->height; y++)
        for (int x = MAX(0, -dx); x < f->width - MAX(0, dx); x++)
            add(&sums, texel_features_at(f, x, y), texel_features_at(f, x + dx, y + dy), f->n);
    return order_of(&sums);
}

static const float *in_map(const struct texel_features *f, const struct index_map *map, int x,
                           int y) {
    const guint16 *s = map->levels[0] +
                       2 * ((gsize)(y % map->height) * (gsize)map->width + (gsize)(x % map->width));
    return texel_features_at(f, s[0], s[1]);
}

/* Returns the autocorrelation ρ (order.h) of a map at the lag (dx, dy), from DRAWN places. */
static double order_map(const struct texel_features *f, const struct index_map *map,
                        const int *places, int dx, int dy) {
    struct order_sums sums = {0};
    for (int k = 0; k < DRAWN; k++) {
        const int x = places[2 * k], y = places[2 * k + 1];
        add(&sums, in_map(f, map, x, y), in_map(f, map, x + dx + map->width, y + dy), f->n);
    }
    return order_of(&sums);
}

static int peak(const struct texel_features *f, gboolean down) {
    const int most = (down ? f->height : f->width) / 2;
    double before = 1, low = 1;
    double now = sample(f, down ? 0 : 1, down ? 1 : 0);
    for (int lag = 1; lag < most; lag++) {
        const double after = sample(f, down ? 0 : lag + 1, down ? lag + 1 : 0);
        low = MIN(low, now);
        if (lag >= MIN_LAG && now >= before && now > after && now >= MIN_PEAK &&
            now >= low + MIN_RISE)
            return lag;
        before = now;
        now = after;
    }
    return 0;
}

int order_period(const struct texel_features *features) {
    return MAX(peak(features, FALSE), peak(features, TRUE));
}

double order_difference(const struct texel_features *features, const struct index_map *map) {
    const int reach = MIN(MIN(features->width, features->height) / 3, MIN(map->width, map->height));
    g_autofree int *places = g_new(int, 2 * DRAWN);
    GRand *random = g_rand_new_with_seed(SEED);
    double squares = 0;
    int n = 0;
    for (int k = 0; k < 2 * DRAWN; k++)
        places[k] = g_rand_int_range(random, 0, k % 2 ? map->height : map->width);
    g_rand_free(random);
    for (int dy = 0; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            const double difference =
                order_map(features, map, places, dx, dy) - sample(features, dx, dy);
            squares += difference * difference;
            n++;
        }
    return sqrt(squares / n);
}

struct order_seams order_seams(const struct texel_features *f, const struct index_map *map) {
    struct order_seams ret = {0};
    double seams = 0, inside = 0;
    gsize n_inside = 0;
    for (int k = 0; k < 2 * map->width * map->height; k++) {
        const int x = k / 2 % map->width, y = k / 2 / map->width;
        const int other_x = (x + (k + 1) % 2) % map->width, other_y = (y + k % 2) % map->height;
        const guint16 *a = map->levels[0] + 2 * ((gsize)y * (gsize)map->width + (gsize)x);
        const guint16 *b =
            map->levels[0] + 2 * ((gsize)other_y * (gsize)map->width + (gsize)other_x);
        ret.pairs++;
        if (b[0] - a[0] == (k + 1) % 2 && b[1] - a[1] == k % 2)
            continue;
        ret.seams++;
        seams += texel_features_square(texel_features_at(f, a[0], a[1]),
                                       texel_features_at(f, b[0], b[1]), f->n);
    }
    for (int y = 0; y < f->height; y++)
        for (int x = 0; x < f->width; x++)
            for (int k = 0; k < 2; k++)
                if (x + 1 - k < f->width && y + k < f->height) {
                    inside += texel_features_square(texel_features_at(f, x, y),
                                                    texel_features_at(f, x + 1 - k, y + k), f->n);
                    n_inside++;
                }
    ret.seam = ret.seams > 0 ? sqrt(seams / ret.seams) : 0;
    ret.inside = n_inside > 0 ? sqrt(inside / (double)n_inside) : 0;
    return ret;
}
