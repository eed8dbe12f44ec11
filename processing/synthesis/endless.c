#include "endless.h"

#include <math.h>
#include <string.h>

/* The sample is divided into GRID × GRID cells. How often each cell is shown tells how evenly the
 * sample is covered. */
#define GRID 16
/* weight of even coverage in endless_cost(); the weight of the pictures is 1 */
#define EVENLY 0.1
#define TRIES  24 /* number of positions of a centre that are tried */
/* number of rounds in which each centre is placed again, after all were placed */
#define SWEEPS 3
/* Centres are drawn from a range that is larger than the allowed one by this factor, and then
 * clamped, so that some centres are at the ends of the allowed range. */
#define SPREAD 1.3
#define SEED   0x656e646cu

/* Sums over the pixels that one or several hexagons show. */
struct shown {
    /* n: number of pixels
     * values: for each picture, the sum of its values
     * squares: for each picture, the sum of the squares of its values */
    double n, values[ENDLESS_PICTURES], squares[ENDLESS_PICTURES];
    double cells[GRID * GRID];
};

struct endless_choice {
    struct endless *endless;
    struct endless_pictures pictures; /* normalised: mean 0 and deviation 1 */
    struct shown all;                 /* sums of the centres that are placed */
};

/* Gives the largest distance of a point of a hexagon from its centre in each dimension, in tiles.
 * The flat sides are at the left and right. */
static void endless_reach(const struct endless *e, float ret[2]) {
    const double column = ENDLESS_COLUMN * MIN(e->width, e->height);
    ret[0] = (float)(0.5 * column / e->width);
    ret[1] = (float)(sqrt(1.0 / 3) * column / e->height);
}

static void add_pixel(const struct endless_pictures *p, int i, int j, struct shown *ret) {
    const float *values = p->values + (gsize)p->n * ((gsize)j * (gsize)p->width + (gsize)i);
    for (int k = 0; k < p->n; k++) {
        ret->values[k] += values[k];
        ret->squares[k] += (double)values[k] * values[k];
    }
    ret->n++;
    ret->cells[j * GRID / p->height * GRID + i * GRID / p->width]++;
}

/* Sums the pixels that the hexagon around a centre shows. */
static void show(const struct endless_choice *c, const float centre[2], struct shown *ret) {
    const struct endless_pictures *p = &c->pictures;
    float reach[2];
    endless_reach(c->endless, reach);
    *ret = (struct shown){0};
    for (int j = 0; j < p->height; j++) {
        const double y = fabs((j + 0.5) / p->height - centre[1]) / reach[1];
        const double half = reach[0] * fmin(1, 2 - 2 * y) * p->width, x = centre[0] * p->width;
        for (int i = MAX(0, (int)ceil(x - half - 0.5));
             half > 0 && i < p->width && i + 0.5 <= x + half; i++)
            add_pixel(p, i, j, ret);
    }
}

static void add(struct shown *to, const struct shown *one, double sign) {
    to->n += sign * one->n;
    for (int k = 0; k < ENDLESS_PICTURES; k++) {
        to->values[k] += sign * one->values[k];
        to->squares[k] += sign * one->squares[k];
    }
    for (int k = 0; k < GRID * GRID; k++)
        to->cells[k] += sign * one->cells[k];
}

/* Returns how much all visible texels, with those of one further hexagon, differ from the sample.
 * The cost consists of the differences in mean and variance of the pictures, and of the unevenness
 * of the coverage. */
static double endless_cost(const struct endless_choice *c, const struct shown *one) {
    const double n = c->all.n + one->n;
    double cost = 0, uneven = 0;
    for (int k = 0; k < c->pictures.n; k++) {
        const double mean = (c->all.values[k] + one->values[k]) / n;
        const double square = (c->all.squares[k] + one->squares[k]) / n;
        cost += mean * mean + (square - 1) * (square - 1);
    }
    for (int k = 0; k < GRID * GRID; k++)
        uneven += pow((c->all.cells[k] + one->cells[k]) * GRID * GRID / n - 1, 2);
    return cost / c->pictures.n + EVENLY * uneven / (GRID * GRID);
}

static void draw(const struct endless *e, GRand *random, float ret[2]) {
    float reach[2];
    endless_reach(e, reach);
    for (int k = 0; k < 2; k++) {
        const double at = 0.5 + SPREAD * (g_rand_double(random) - 0.5);
        ret[k] = (float)(reach[k] + CLAMP(at, 0, 1) * MAX(1 - 2 * reach[k], 0));
    }
}

/* Puts centre k at the best of TRIES random positions. If again is TRUE, the centre already has a
 * position, and keeps it if no other is better. */
static void place_centre(struct endless_choice *c, int k, gboolean again, GRand *random) {
    float *centre = c->endless->centres[k];
    double least = G_MAXDOUBLE;
    struct shown one, best = {0};
    if (again) {
        show(c, centre, &best);
        add(&c->all, &best, -1);
        least = endless_cost(c, &best);
    }
    for (int try = 0; try < TRIES; try++) {
        float at[2];
        draw(c->endless, random, at);
        show(c, at, &one);
        const double cost = endless_cost(c, &one);
        if (cost < least) {
            least = cost;
            best = one;
            memcpy(centre, at, sizeof at);
        }
    }
    add(&c->all, &best, 1);
}

/* Returns copies of the pictures with a mean of 0 and a standard deviation of 1. A picture without
 * contrast becomes 0. */
static float *normalise(int pixels, int n, const float *pictures) {
    float *ret = g_new(float, (gsize)pixels *(gsize)n);
    for (int k = 0; k < n; k++) {
        double sum = 0, squares = 0;
        for (int i = 0; i < pixels; i++)
            sum += pictures[(gsize)i * (gsize)n + (gsize)k];
        for (int i = 0; i < pixels; i++)
            squares += pow(pictures[(gsize)i * (gsize)n + (gsize)k] - sum / pixels, 2);
        const double scale = squares > 0 ? sqrt(pixels / squares) : 0;
        for (gsize i = (gsize)k; i < (gsize)pixels * (gsize)n; i += (gsize)n)
            ret[i] = (float)(scale * (pictures[i] - sum / pixels));
    }
    return ret;
}

struct endless *endless_new(int width, int height, const struct endless_pictures *pictures) {
    struct endless *e = g_new0(struct endless, 1);
    g_autofree float *normal =
        normalise(pictures->width * pictures->height, pictures->n, pictures->values);
    struct endless_choice choice = {.endless = e, .pictures = *pictures};
    choice.pictures.values = normal;
    GRand *random = g_rand_new_with_seed(SEED);
    e->width = width;
    e->height = height;
    e->edge[0] = 0.5F / (float)width;
    e->edge[1] = 0.5F / (float)height;
    for (int sweep = 0; sweep <= SWEEPS; sweep++)
        for (int k = 0; k < ENDLESS_CENTRES; k++)
            place_centre(&choice, k, sweep > 0, random);
    g_rand_free(random);
    return e;
}

void endless_free(struct endless *endless) {
    g_free(endless);
}

void endless_lattice_init(struct endless_lattice *lattice, const struct endless *e, double tiles_u,
                          double tiles_v) {
    const double column = ENDLESS_COLUMN * MIN(e->width, e->height);
    const double columns = ceil(tiles_u * e->width / column - 1e-6);
    const double rows = 2 * ceil(tiles_v * e->height / (sqrt(3) * column) - 1e-6);
    lattice->period[0] = (int)MAX(columns, 1);
    lattice->period[1] = (int)MAX(rows, 2);
    lattice->cells[0] = (float)(lattice->period[0] / tiles_u);
    lattice->cells[1] = (float)(lattice->period[1] / tiles_v);
}

/* Returns a hash of two integers, pcg2d. */
static guint32 hash(guint32 x, guint32 y) {
    x = x * 1664525u + 1013904223u;
    y = y * 1664525u + 1013904223u;
    x += y * 1664525u;
    y += x * 1664525u;
    x ^= x >> 16;
    y ^= y >> 16;
    x += y * 1664525u;
    return x ^ (x >> 16);
}

/* Returns ⌊a / b⌋, b > 0. */
static int turns(int a, int b) {
    return (a >= 0 ? a : a - b + 1) / b;
}

/* Gives the position of a point in the part of the sample that the hexagon around a vertex
 * shows. */
static void look_up(const struct endless *e, const struct endless_lattice *lattice,
                    const float x[2], const int vertex[2], float ret[2]) {
    const int *period = lattice->period, turn = turns(vertex[1], period[1]);
    const int row = vertex[1] - turn * period[1];
    int column = vertex[0] + turn * (period[1] / 2);
    column -= period[0] * turns(column, period[0]);
    const float *centre = e->centres[hash((guint32)column, (guint32)row) % ENDLESS_CENTRES];
    ret[0] = x[0] - ((float)vertex[0] + 0.5F * (float)vertex[1]) / lattice->cells[0] + centre[0];
    ret[1] = x[1] - (float)vertex[1] / lattice->cells[1] + centre[1];
    for (int k = 0; k < 2; k++)
        ret[k] = CLAMP(ret[k], e->edge[k], 1 - e->edge[k]);
}

void endless_find(const struct endless *e, const struct endless_lattice *lattice, const float x[2],
                  struct endless_places *ret) {
    const float row = x[1] * lattice->cells[1], column = x[0] * lattice->cells[0] - 0.5F * row;
    const float f[2] = {column - floorf(column), row - floorf(row)};
    const int base[2] = {(int)floorf(column), (int)floorf(row)}, far = f[0] + f[1] > 1;
    const int vertices[3][2] = {
        {base[0] + far, base[1] + far}, {base[0] + 1, base[1]}, {base[0], base[1] + 1}};
    const float w[3] = {far ? f[0] + f[1] - 1 : 1 - f[0] - f[1], far ? 1 - f[1] : f[0],
                        far ? 1 - f[0] : f[1]};
    const float most = fmaxf(w[0], fmaxf(w[1], w[2]));
    const int first = w[0] == most ? 0 : w[1] == most ? 1 : 2;
    float squares = 0;
    ret->n = 0;
    for (int k = 0; k < 3; k++) {
        const int at = (first + k) % 3;
        const float share = fmaxf(w[at] - most + (float)ENDLESS_BLEND, 0);
        if (share <= 0)
            continue;
        look_up(e, lattice, x, vertices[at], ret->x[ret->n]);
        ret->weight[ret->n++] = share;
        squares += share * share;
    }
    ret->mean = 1;
    for (int k = 0; k < ret->n; k++) {
        ret->weight[k] /= sqrtf(squares);
        ret->mean -= ret->weight[k];
    }
}
