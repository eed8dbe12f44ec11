/* Recognises the circles of a board by their places relative to their neighbours. One spot and two
 * steps to its neighbours begin the grid. Integer coordinates then spread from spot to spot. Each
 * spot predicts its neighbours with the steps that led to it. The steps are an arbitrary basis of
 * the grid's lattice. Integer maps with small coefficients are tried, and the map that turns the
 * coordinates into a full rectangle is used. */
#include "spot_grid.h"

#include <math.h>
#include <string.h>

#define MAX_SPOTS 1600 /* 40 × 40 */
#define SEEDS     8    /* number of spots that are tried as a beginning */
#define NEAR      0.25 /* largest deviation of a spot from its predicted place, in steps */
#define MIN_TURN  0.35 /* smallest sine of the angle between the two steps */
#define LEAST     3    /* smallest number of circles in a row and in a column */
#define REACH     2    /* largest absolute coefficient of the integer maps */

struct node {
    int a, b; /* integer coordinates in the grid */
    gboolean known;
    double step[2][2]; /* from this spot to the next one along a, and along b */
};

struct lattice {
    const double *xy;
    int n;
    struct node *nodes; /* one for each of the n spots */
};

/* Returns the spot that is nearest to a place. Returns −1 if none is nearer than `within`. */
static int nearest(const struct lattice *lattice, const double at[2], double within) {
    double least = within * within;
    int best = -1;
    for (int i = 0; i < lattice->n; i++) {
        const double dx = lattice->xy[2 * i] - at[0], dy = lattice->xy[2 * i + 1] - at[1];
        if (dx * dx + dy * dy >= least)
            continue;
        least = dx * dx + dy * dy;
        best = i;
    }
    return best;
}

/* Gives the step from a seed to the nearest spot, and the step to the nearest spot in another
 * direction. Returns FALSE if there is no such spot. */
static gboolean first_steps(const struct lattice *lattice, int seed, double ret[2][2]) {
    const double *from = lattice->xy + 2 * seed;
    double length[2] = {INFINITY, INFINITY};
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < lattice->n; i++) {
            const double d[2] = {lattice->xy[2 * i] - from[0], lattice->xy[2 * i + 1] - from[1]};
            const double far = hypot(d[0], d[1]);
            if (i == seed || far >= length[k] ||
                (k == 1 && fabs(d[0] * ret[0][1] - d[1] * ret[0][0]) < MIN_TURN * far * length[0]))
                continue;
            length[k] = far;
            memcpy(ret[k], d, sizeof d);
        }
    return isfinite(length[1]);
}

/* Gives grid indices (a, b) to the spot seed and to all spots that can be reached from it step by
 * step. Returns the number of spots that have indices. */
static int spread(struct lattice *lattice, int seed) {
    g_autofree int *queue = g_new(int, lattice->n + 1);
    int in = 0;
    memset(lattice->nodes, 0, sizeof *lattice->nodes * (gsize)lattice->n);
    if (!first_steps(lattice, seed, lattice->nodes[seed].step))
        return 0;
    lattice->nodes[seed].known = TRUE;
    queue[in++] = seed;
    for (int next = 0; next < in; next++) {
        const int from = queue[next];
        struct node *node = &lattice->nodes[from];
        for (int way = 0; way < 4; way++) {
            const int axis = way / 2, sign = way % 2 ? -1 : 1;
            const double *step = node->step[axis], *xy = lattice->xy + 2 * from;
            const double at[2] = {xy[0] + sign * step[0], xy[1] + sign * step[1]};
            const double other =
                MIN(hypot(step[0], step[1]), hypot(node->step[!axis][0], node->step[!axis][1]));
            const int i = nearest(lattice, at, NEAR * other);
            if (i < 0 || lattice->nodes[i].known)
                continue;
            struct node *to = &lattice->nodes[i];
            memcpy(to->step, node->step, sizeof to->step);
            for (int k = 0; k < 2; k++)
                to->step[axis][k] = sign * (lattice->xy[2 * i + k] - xy[k]);
            to->a = node->a + (axis == 0 ? sign : 0);
            to->b = node->b + (axis == 1 ? sign : 0);
            to->known = TRUE;
            queue[in++] = i;
        }
    }
    return in;
}

struct rectangle {
    int columns, rows;
    int *spot; /* columns × rows; index of the spot, or −1 */
};

/* Returns whether the coordinates x = m₀ a + m₁ b, y = m₂ a + m₃ b of the known spots fill a
 * rectangle. In a staggered grid, y is the row. Every row has the same number of circles, which are
 * 2 apart in x. x is even and odd in alternate rows. */
static gboolean fills(const struct lattice *lattice, const int m[4], gboolean staggered, int known,
                      struct rectangle *ret) {
    int low[2] = {G_MAXINT, G_MAXINT}, high[2] = {-G_MAXINT, -G_MAXINT};
    for (int i = 0; i < lattice->n; i++) {
        const struct node *node = &lattice->nodes[i];
        const int at[2] = {m[0] * node->a + m[1] * node->b, m[2] * node->a + m[3] * node->b};
        for (int k = 0; node->known && k < 2; k++) {
            low[k] = MIN(low[k], at[k]);
            high[k] = MAX(high[k], at[k]);
        }
    }
    const int wide = high[0] - low[0] + 1, rows = high[1] - low[1] + 1;
    const int columns = staggered ? wide / 2 : wide;
    if ((staggered && wide % 2) || columns < (staggered ? 2 : LEAST) || rows < LEAST ||
        columns * rows != known)
        return FALSE;
    ret->columns = columns;
    ret->rows = rows;
    for (int i = 0; i < known; i++)
        ret->spot[i] = -1;
    for (int i = 0; i < lattice->n; i++) {
        const struct node *node = &lattice->nodes[i];
        if (!node->known)
            continue;
        const int x = m[0] * node->a + m[1] * node->b - low[0];
        const int y = m[2] * node->a + m[3] * node->b - low[1];
        if (staggered && (x - y) % 2 != 0)
            return FALSE;
        int *spot = &ret->spot[y * columns + (staggered ? x / 2 : x)];
        if (*spot >= 0)
            return FALSE;
        *spot = i;
    }
    return TRUE;
}

GArray *spot_grid_find(const GArray *spots, gboolean staggered, int *ret_columns, int *ret_rows) {
    const int n = (int)spots->len / 2, all = 2 * REACH + 1;
    if (n < LEAST * LEAST || n > MAX_SPOTS)
        return NULL;
    g_autofree struct node *nodes = g_new0(struct node, n);
    g_autofree int *spot = g_new(int, n);
    struct lattice lattice = {(const double *)(gconstpointer)spots->data, n, nodes};
    struct rectangle found = {.spot = spot};
    int known = 0;
    for (int k = 0; k < SEEDS && 2 * known <= n; k++)
        known = spread(&lattice, k * (n - 1) / (SEEDS - 1));
    if (2 * known <= n)
        return NULL;
    for (int i = 0; i < all * all * all * all; i++) {
        int m[4];
        for (int k = 0, rest = i; k < 4; k++, rest /= all)
            m[k] = rest % all - REACH;
        if (abs(m[0] * m[3] - m[1] * m[2]) != (staggered ? 2 : 1) ||
            !fills(&lattice, m, staggered, known, &found))
            continue;
        GArray *ret = g_array_new(FALSE, FALSE, sizeof(double));
        for (int s = 0; s < known; s++)
            g_array_append_vals(ret, lattice.xy + 2 * (gsize)found.spot[s], 2);
        *ret_columns = found.columns;
        *ret_rows = found.rows;
        return ret;
    }
    return NULL;
}
