#include "plan_private.h"

#include <string.h>

#define GAIN 1e-9

static double cost(const struct plan_path *t, int from, int to) {
    return t->cost(t->data, from, to);
}

/* Returns the element at an index; −1 if the index is before the first or after the last
 * element. */
static int at(const struct plan_path *t, int index) {
    return index < 0 || index >= t->n ? -1 : t->order[index];
}

static double edge(const struct plan_path *t, int from_index, int to_index) {
    return cost(t, at(t, from_index), at(t, to_index));
}

double plan_path_cost(const struct plan_path *path) {
    double sum = 0;

    for (int i = 0; i <= path->n; i++)
        sum += edge(path, i - 1, i);
    return sum;
}

/* Returns the cost of the two steps that join a segment from element a to element b to the elements
 * at two indices. */
static double join(const struct plan_path *t, int from_index, int a, int b, int to_index) {
    return cost(t, at(t, from_index), a) + cost(t, b, at(t, to_index));
}

/* 2-opt: reverses segments i … j that cost less in the other direction. The cost of a step may
 * depend on its direction (backlash), so that the cost within the segment also changes. Returns
 * whether any segment was reversed. */
static gboolean improve_by_reversing(struct plan_path *t, gint64 *budget) {
    gboolean improved = FALSE;

    for (int i = 0; i < t->n - 1 && *budget > 0; i++) {
        double change = 0;
        for (int j = i + 1; *budget > 0 && j < t->n; j++, (*budget)--) {
            change += cost(t, t->order[j], t->order[j - 1]) - edge(t, j - 1, j);
            double ends = join(t, i - 1, t->order[j], t->order[i], j + 1) - edge(t, i - 1, i) -
                          edge(t, j, j + 1);
            if (change + ends >= -GAIN)
                continue;
            for (int a = i, b = j; a < b; a++, b--) {
                int kept = t->order[a];
                t->order[a] = t->order[b];
                t->order[b] = kept;
            }
            improved = TRUE;
            break;
        }
    }
    return improved;
}

/* Moves the k elements from index i to before index j, which is not among them. */
static void move_segment(struct plan_path *t, int i, int k, int j) {
    g_autofree int *taken = g_memdup2(t->order + i, sizeof(int) * (gsize)k);

    if (j > i) {
        memmove(t->order + i, t->order + i + k, sizeof(int) * (gsize)(j - i - k));
        memcpy(t->order + j - k, taken, sizeof(int) * (gsize)k);
    } else {
        memmove(t->order + j + k, t->order + j, sizeof(int) * (gsize)(i - j));
        memcpy(t->order + j, taken, sizeof(int) * (gsize)k);
    }
}

/* Or-opt: moves segments of at most longest_moved elements to places where they cost less. Returns
 * whether any segment was moved. */
static gboolean improve_by_moving(struct plan_path *t, gint64 *budget) {
    gboolean improved = FALSE;

    for (int k = 1; k <= t->longest_moved; k++)
        for (int i = 0; i + k <= t->n && *budget > 0; i++) {
            double gain = edge(t, i - 1, i) + edge(t, i + k - 1, i + k) - edge(t, i - 1, i + k);
            if (gain <= GAIN)
                continue;
            for (int j = 0; j <= t->n; j++, (*budget)--) {
                if (j >= i && j <= i + k)
                    continue;
                double loss =
                    join(t, j - 1, t->order[i], t->order[i + k - 1], j) - edge(t, j - 1, j);
                if (loss >= gain - GAIN)
                    continue;
                move_segment(t, i, k, j);
                improved = TRUE;
                break;
            }
        }
    return improved;
}

void plan_path_improve(struct plan_path *path, gint64 budget) {
    while (budget > 0 && plan_path_cost(path) > path->least + GAIN &&
           (improve_by_reversing(path, &budget) || improve_by_moving(path, &budget)))
        ;
}
