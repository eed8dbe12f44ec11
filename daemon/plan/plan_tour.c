#include "plan_private.h"

#include <stdlib.h>
#include <string.h>

/* Maximum number of cost lookups in the local search for a better tour. */
#define SEARCH_BUDGET 300000
/* Maximum number of poses of a tour that is improved by the search. Longer tours keep the best of
 * the simple orders. */
#define SEARCH_LARGEST 3000
#define LONGEST_MOVED  3
#define GAIN_S         1e-9

struct tour {
    const struct plan_moves *moves;
    double floor_s;
    int *order;
    int n;
};

static double cost(const struct tour *t, int from, int to) {
    double move = plan_move_s(t->moves, from, to);
    return move > t->floor_s ? move : t->floor_s;
}

static double cost_of(gconstpointer data, int from, int to) {
    return from < 0 || to < 0 ? 0 : cost(data, from, to);
}

static int compare_udeg(gconstpointer a, gconstpointer b) {
    gint64 x = *(const gint64 *)a, y = *(const gint64 *)b;
    return (x > y) - (x < y);
}

/* Numbers the different positions of an axis, and makes the table of the times of moves between two
 * positions. */
static struct plan_axis_moves axis_moves(const gint64 *udeg, int n,
                                         const struct axis_motion *motion) {
    g_autofree gint64 *sorted = g_memdup2(udeg, sizeof *udeg * (gsize)n);
    struct plan_axis_moves axis = {.wraps = motion->wraps, .at = g_new0(int, n)};

    qsort(sorted, (gsize)n, sizeof *sorted, compare_udeg);
    for (int i = 0; i < n; i++)
        if (i == 0 || sorted[i] != sorted[axis.n - 1])
            sorted[axis.n++] = sorted[i];
    const gsize rows = (gsize)axis.n;
    for (int i = 0; i < n; i++)
        axis.at[i] =
            (int)((gint64 *)bsearch(&udeg[i], sorted, rows, sizeof *sorted, compare_udeg) - sorted);
    axis.s = g_new(double, rows *rows);
    for (gsize i = 0; i < rows; i++)
        for (gsize j = 0; j < rows; j++)
            axis.s[i * rows + j] =
                axis_move_time_s(motion, (double)sorted[i] / UDEG, (double)sorted[j] / UDEG);
    return axis;
}

struct plan_moves *plan_moves_new(const struct plan_pose *poses, int n,
                                  const struct rig_timing *timing) {
    struct plan_moves *moves = g_new0(struct plan_moves, 1);
    g_autofree gint64 *turn = g_new0(gint64, n), *arc = g_new0(gint64, n);
    g_autofree gint64 *arm = g_new0(gint64, n), *probe = g_new0(gint64, n);

    for (int i = 0; i < n; i++) {
        turn[i] = poses[i].turntable_udeg;
        arc[i] = poses[i].arc_udeg;
        arm[i] = poses[i].arm_udeg;
        probe[i] = poses[i].probe_udeg;
    }
    *moves = (struct plan_moves){.n = n,
                                 .poses = poses,
                                 .turntable = axis_moves(turn, n, &timing->turntable),
                                 .arc = axis_moves(arc, n, &timing->arc),
                                 .arm = axis_moves(arm, n, &timing->arm),
                                 .probe = axis_moves(probe, n, &timing->probe)};
    return moves;
}

void plan_moves_free(struct plan_moves *moves) {
    if (!moves)
        return;
    g_free(moves->turntable.at);
    g_free(moves->turntable.s);
    g_free(moves->arc.at);
    g_free(moves->arc.s);
    g_free(moves->arm.at);
    g_free(moves->arm.s);
    g_free(moves->probe.at);
    g_free(moves->probe.s);
    g_free(moves);
}

/* A pose with its sort keys: the angles of arm and probe, the angle that is the same for the poses
 * of its row (row), and the angle that orders the poses of the row (column). */
struct cell {
    gint64 arm, probe, row, column;
    int pose;
};

enum rows { ROWS_OF_ARC, ROWS_OF_TURNTABLE, ROWS_OF_LIGHT, N_ROWS };

static gboolean same_row(const struct cell *x, const struct cell *y) {
    return x->arm == y->arm && x->probe == y->probe && x->row == y->row;
}

static int compare_cells(gconstpointer a, gconstpointer b) {
    const struct cell *x = a, *y = b;

    if (!same_row(x, y))
        return x->arm != y->arm       ? (x->arm > y->arm ? 1 : -1)
               : x->probe != y->probe ? (x->probe > y->probe ? 1 : -1)
                                      : (x->row > y->row ? 1 : -1);
    if (x->column != y->column)
        return x->column > y->column ? 1 : -1;
    return x->pose - y->pose;
}

/* Appends the k poses of a row to the tour at the lowest cost. The row may be entered at any of its
 * poses and is then traversed cyclically, upwards or downwards. */
static void append_row(struct tour *t, const struct cell *row, int k) {
    int best_start = 0, best_step = 1;
    double best = G_MAXDOUBLE;

    for (int step = 1; step >= -1; step -= 2) {
        double around = 0;
        for (int i = 0; i < k; i++)
            around += cost(t, row[i].pose, row[(i + step + k) % k].pose);
        for (int start = 0; start < k; start++) {
            double enter = t->n ? cost(t, t->order[t->n - 1], row[start].pose) : 0;
            double gap = cost(t, row[(start - step + k) % k].pose, row[start].pose);
            if (enter + around - gap < best - GAIN_S) {
                best = enter + around - gap;
                best_start = start;
                best_step = step;
            }
        }
    }
    for (int i = 0; i < k; i++)
        t->order[t->n++] = row[((best_start + i * best_step) % k + k) % k].pose;
}

/* Makes a tour that visits the poses row by row. The poses of a row have the same angle of the arc
 * (ROWS_OF_ARC), of the turntable (ROWS_OF_TURNTABLE) or of the arc minus the turntable
 * (ROWS_OF_LIGHT). Along a row of ROWS_OF_LIGHT, turntable and arc turn together. */
static void tour_by_rows(struct tour *t, const int *poses, int n, enum rows rows) {
    g_autofree struct cell *cells = g_new(struct cell, n);

    for (int i = 0; i < n; i++) {
        gint64 turn = t->moves->poses[poses[i]].turntable_udeg;
        gint64 arc = t->moves->poses[poses[i]].arc_udeg;
        gint64 arm = t->moves->poses[poses[i]].arm_udeg;
        gint64 probe = t->moves->poses[poses[i]].probe_udeg;
        gboolean wraps = t->moves->turntable.wraps || t->moves->arc.wraps;
        gint64 light = wraps ? plan_wrap(arc - turn) : arc - turn;
        gint64 row = rows == ROWS_OF_ARC ? arc : rows == ROWS_OF_TURNTABLE ? turn : light;
        cells[i] = (struct cell){arm, probe, row, rows == ROWS_OF_TURNTABLE ? arc : turn, poses[i]};
    }
    qsort(cells, (gsize)n, sizeof *cells, compare_cells);
    t->n = 0;
    for (int i = 0, k; i < n; i += k) {
        for (k = 1; i + k < n && same_row(&cells[i + k], &cells[i]); k++)
            ;
        append_row(t, cells + i, k);
    }
}

static void tour_nearest(struct tour *t, const int *poses, int n) {
    g_autofree int *left = g_memdup2(poses, sizeof *poses * (gsize)n);

    t->n = 0;
    t->order[t->n++] = left[0];
    left[0] = left[--n];
    while (n > 0) {
        int nearest = 0;
        double best = G_MAXDOUBLE;
        for (int i = 0; i < n; i++) {
            double c = cost(t, t->order[t->n - 1], left[i]);
            if (c < best || (c == best && left[i] < left[nearest])) {
                best = c;
                nearest = i;
            }
        }
        t->order[t->n++] = left[nearest];
        left[nearest] = left[--n];
    }
}

void plan_tour(const struct plan_moves *moves, int *poses, int n, double floor_s) {
    g_autofree int *order = g_new(int, MAX(n, 1)), *best = g_memdup2(poses, sizeof(int) * (gsize)n);
    double best_s = G_MAXDOUBLE;

    for (int candidate = 0; n > 1 && candidate <= N_ROWS; candidate++) {
        struct tour t = {.moves = moves, .floor_s = floor_s, .order = order};
        if (candidate < N_ROWS)
            tour_by_rows(&t, poses, n, (enum rows)candidate);
        else
            tour_nearest(&t, poses, n);
        struct plan_path path = {.order = t.order,
                                 .n = t.n,
                                 .cost = cost_of,
                                 .data = &t,
                                 .longest_moved = LONGEST_MOVED,
                                 .least = floor_s * (t.n - 1)};
        if (t.n <= SEARCH_LARGEST)
            plan_path_improve(&path, SEARCH_BUDGET);
        double cost_s = plan_path_cost(&path);
        if (cost_s < best_s - GAIN_S) {
            best_s = cost_s;
            memcpy(best, order, sizeof(int) * (gsize)n);
        }
    }
    if (n > 1)
        memcpy(poses, best, sizeof(int) * (gsize)n);
}
