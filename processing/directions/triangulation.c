/* Adds points in order of x, then flips edges until the triangulation is Delaunay. The points are
 * some hundred measured directions, so that linear searches are fast enough for this. Queries use a
 * grid of cells. Each cell lists the triangles that may cover a part of the cell. */
#include "triangulation.h"

#include <math.h>
#include <string.h>

/* Maximum random displacement of a point. After the displacement, no four points lie on one
 * circle. */
#define JITTER 1e-7
/* If no point is farther than this from a line, the points count as collinear. Triangles of such
 * points would be so thin that their shape depended on the random displacements. */
#define LINE (10 * JITTER)

struct triangle {
    int corner[3]; /* counter-clockwise */
};

struct Triangulation {
    int n;
    double *points; /* n × 2, displaced */
    GArray *triangles;
    /* Indices (int) of the points of the hull, counter-clockwise. If all points lie on a line,
     * these are all indices in their order along the line. */
    GArray *hull;
    /* A grid over the points: cell k has triangles covering[first[k] … first[k + 1] − 1], in
     * ascending order. */
    int n_cells;            /* number of cells along each axis */
    double low[2], cell[2]; /* lower corner of the grid, and size of a cell */
    int *first, *covering;
};

static const double *point(const Triangulation *t, int index) {
    return t->points + 2 * index;
}

/* Returns twice the area of the triangle a, b, c; positive if counter-clockwise. */
static double area(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static double turn(const Triangulation *t, int a, int b, int c) {
    return area(point(t, a), point(t, b), point(t, c));
}

/* Returns whether the point d, whose index is `other`, is within the circumcircle of a
 * counter-clockwise triangle with the corners p_k. This is the case if the determinant of the three
 * rows (p_k − d, |p_k − d|²) is positive. */
static gboolean in_circle(const Triangulation *t, const int corner[3], int other) {
    double m[3][3];
    const double *d = point(t, other);
    for (int k = 0; k < 3; k++) {
        m[k][0] = point(t, corner[k])[0] - d[0];
        m[k][1] = point(t, corner[k])[1] - d[1];
        m[k][2] = m[k][0] * m[k][0] + m[k][1] * m[k][1];
    }
    double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                 m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                 m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    return det > 1e-15;
}

static int compare_x(gconstpointer a, gconstpointer b, gpointer data) {
    const Triangulation *t = data;
    const double *p = point(t, *(const int *)a), *q = point(t, *(const int *)b);
    if (p[0] != q[0])
        return p[0] < q[0] ? -1 : 1;
    return p[1] < q[1] ? -1 : p[1] > q[1];
}

/* Adds a point that is to the right of all earlier points. Connects it with each edge of the hull
 * that faces it. */
static void add_point(Triangulation *t, int p) {
    const int *hull = (const int *)t->hull->data;
    guint n = t->hull->len;
    g_autoptr(GArray) next = g_array_new(FALSE, FALSE, sizeof(int));
    gboolean added = FALSE;
    for (guint k = 0; k < n; k++) {
        int before = hull[(k + n - 1) % n], here = hull[k], after = hull[(k + 1) % n];
        gboolean sees_in = turn(t, before, here, p) < 0.0;
        gboolean sees_out = turn(t, here, after, p) < 0.0;
        if (sees_out) {
            struct triangle triangle = {{after, here, p}};
            g_array_append_val(t->triangles, triangle);
        }
        if (!(sees_in && sees_out))
            g_array_append_val(next, here);
        if (sees_out && !sees_in) {
            g_array_append_val(next, p);
            added = TRUE;
        }
    }
    if (!added)
        return; /* the point lies on the border within rounding errors, and is left out */
    g_array_unref(t->hull);
    t->hull = g_steal_pointer(&next);
}

/* Flips the edge that two triangles share if it is not locally Delaunay and their union is convex.
 * Returns whether the edge was flipped. */
static gboolean flip(Triangulation *t, guint k, int edge) {
    struct triangle *one = &g_array_index(t->triangles, struct triangle, k);
    int a = one->corner[edge], b = one->corner[(edge + 1) % 3], c = one->corner[(edge + 2) % 3];
    struct triangle *two = NULL;
    int d = -1; /* third corner of the other triangle */
    for (guint i = 0; !two && i < t->triangles->len; i++)
        for (int e = 0; e < 3; e++) {
            struct triangle *other = &g_array_index(t->triangles, struct triangle, i);
            if (other->corner[e] != b || other->corner[(e + 1) % 3] != a)
                continue;
            two = other;
            d = other->corner[(e + 2) % 3];
        }
    if (!two || !in_circle(t, one->corner, d) || turn(t, c, a, d) <= 0.0 || turn(t, c, d, b) <= 0.0)
        return FALSE;
    *one = (struct triangle){{c, a, d}};
    *two = (struct triangle){{c, d, b}};
    return TRUE;
}

/* Returns the index of the cell along an axis. Points beyond the grid belong to its outermost
 * cells. */
static int triangulation_along(const Triangulation *t, double at, int axis) {
    const double k = (at - t->low[axis]) / t->cell[axis];
    return k > 0.0 ? (int)MIN(k, (double)(t->n_cells - 1)) : 0;
}

static int triangulation_cell(const Triangulation *t, const double at[2]) {
    return triangulation_along(t, at[1], 1) * t->n_cells + triangulation_along(t, at[0], 0);
}

/* Gives the cells x[0] … x[1], y[0] … y[1] that the bounding box of a triangle overlaps. */
static void box(const Triangulation *t, guint k, int ret_x[2], int ret_y[2]) {
    const int *corner = g_array_index(t->triangles, struct triangle, k).corner;
    int *const range[2] = {ret_x, ret_y};
    for (int axis = 0; axis < 2; axis++)
        for (int c = 0; c < 3; c++) {
            const int here = triangulation_along(t, point(t, corner[c])[axis], axis);
            range[axis][0] = c == 0 ? here : MIN(range[axis][0], here);
            range[axis][1] = c == 0 ? here : MAX(range[axis][1], here);
        }
}

/* Makes the grid, with about as many cells as there are triangles. Counts the triangles of each
 * cell first, then stores their indices. */
static void make_grid(Triangulation *t) {
    double high[2] = {-G_MAXDOUBLE, -G_MAXDOUBLE};
    t->low[0] = t->low[1] = G_MAXDOUBLE;
    for (int k = 0; k < 2 * t->n; k++) {
        t->low[k % 2] = MIN(t->low[k % 2], t->points[k]);
        high[k % 2] = MAX(high[k % 2], t->points[k]);
    }
    t->n_cells = MAX(1, (int)sqrt((double)t->triangles->len));
    for (int axis = 0; axis < 2; axis++)
        t->cell[axis] = MAX((high[axis] - t->low[axis]) / t->n_cells, JITTER);
    const int n = t->n_cells * t->n_cells;
    t->first = g_new0(int, n + 1);
    for (int fill = 0; fill < 2; fill++) {
        for (guint k = 0; k < t->triangles->len; k++) {
            int x[2], y[2];
            box(t, k, x, y);
            for (int j = y[0]; j <= y[1]; j++)
                for (int i = x[0]; i <= x[1]; i++)
                    if (fill)
                        t->covering[t->first[j * t->n_cells + i]++] = (int)k;
                    else
                        t->first[j * t->n_cells + i + 1]++;
        }
        /* After counting, first[k] becomes the position at which cell k begins, by summing the
         * counts. Filling moves first[k] to the end of cell k. The second loop shifts the array by
         * one cell, because cell k + 1 begins where cell k ends. */
        for (int cell = 0; !fill && cell < n; cell++)
            t->first[cell + 1] += t->first[cell];
        if (!fill)
            t->covering = g_new(int, MAX(t->first[n], 1));
        for (int cell = n; fill && cell > 0; cell--)
            t->first[cell] = t->first[cell - 1];
    }
    t->first[0] = 0;
}

struct along {
    const double *points;
    double x, y; /* direction of the line */
};

static int compare_along(gconstpointer a, gconstpointer b, gpointer data) {
    const struct along *along = data;
    const double *p = along->points + (gsize)2 * *(const int *)a;
    const double *q = along->points + (gsize)2 * *(const int *)b;
    const double ahead = (p[0] - q[0]) * along->x + (p[1] - q[1]) * along->y;
    return (ahead > 0.0) - (ahead < 0.0);
}

/* If all points are on a line, sorts them along the line and returns TRUE. */
static gboolean triangulation_line(const double *points, int n, int *order) {
    struct along along = {points, 0.0, 0.0};
    double length = 0.0;
    for (int k = 1; k < n; k++) {
        const double x = points[2 * k] - points[0], y = points[2 * k + 1] - points[1];
        if (hypot(x, y) > length) {
            length = hypot(x, y);
            along.x = x / length;
            along.y = y / length;
        }
    }
    for (int k = 1; k < n; k++)
        if (fabs((points[2 * k] - points[0]) * along.y -
                 (points[2 * k + 1] - points[1]) * along.x) > LINE)
            return FALSE;
    g_qsort_with_data(order, n, sizeof(int), compare_along, &along);
    return TRUE;
}

Triangulation *triangulation_new(const double *points, int n) {
    Triangulation *t = g_new0(Triangulation, 1);
    t->n = n;
    t->points = g_new(double, 2 * (gsize)n);
    t->triangles = g_array_new(FALSE, FALSE, sizeof(struct triangle));
    t->hull = g_array_new(FALSE, FALSE, sizeof(int));
    g_autofree int *order = g_new(int, n);
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    for (int k = 0; k < n; k++) {
        order[k] = k;
        for (int axis = 0; axis < 2; axis++)
            t->points[2 * k + axis] =
                points[2 * k + axis] + g_rand_double_range(random, -JITTER, JITTER);
    }
    if (triangulation_line(points, n, order)) {
        memcpy(t->points, points, sizeof *points * 2 * (gsize)n);
        g_array_append_vals(t->hull, order, (guint)n);
        make_grid(t);
        return t;
    }
    g_qsort_with_data(order, n, sizeof(int), compare_x, t);
    /* Makes a triangulation by adding points from left to right. */
    g_array_append_vals(t->hull, order, 3);
    struct triangle first = {{order[0], order[1], order[2]}};
    if (turn(t, order[0], order[1], order[2]) < 0.0) {
        first = (struct triangle){{order[0], order[2], order[1]}};
        g_array_index(t->hull, int, 1) = order[2];
        g_array_index(t->hull, int, 2) = order[1];
    }
    g_array_append_val(t->triangles, first);
    for (int k = 3; k < n; k++)
        add_point(t, order[k]);
    /* Lawson's algorithm (1977) flips edges until all are locally Delaunay. In exact arithmetic
     * this always ends. Rounding errors might prevent the end, and therefore the number of passes
     * is limited. */
    gboolean flipped = TRUE;
    for (int pass = 0; flipped && pass < 200; pass++) {
        flipped = FALSE;
        for (guint k = 0; k < t->triangles->len; k++)
            for (int edge = 0; edge < 3; edge++)
                flipped |= flip(t, k, edge);
    }
    make_grid(t);
    return t;
}

void triangulation_free(Triangulation *t) {
    if (t == NULL)
        return;
    g_array_unref(t->hull);
    g_array_unref(t->triangles);
    g_free(t->points);
    g_free(t->first);
    g_free(t->covering);
    g_free(t);
}

/* Returns whether triangle k contains a point: all barycentric weights b_k = area(opposite edge,
 * point) / area(triangle) are ≥ 0. Gives the weights in ret. A degenerate triangle contains no
 * point, and ret is then unchanged. */
static gboolean inside(const Triangulation *t, guint k, const double at[2], double ret[3]) {
    const int *corner = g_array_index(t->triangles, struct triangle, k).corner;
    const double *a = point(t, corner[0]), *b = point(t, corner[1]), *c = point(t, corner[2]);
    double whole = area(a, b, c);
    if (whole <= 0.0)
        return FALSE;
    ret[0] = area(b, c, at) / whole;
    ret[1] = area(c, a, at) / whole;
    ret[2] = 1.0 - ret[0] - ret[1];
    return ret[0] >= 0.0 && ret[1] >= 0.0 && ret[2] >= 0.0;
}

void triangulation_weights(const Triangulation *t, const double at[2], int ret_index[3],
                           double ret_weight[3], double ret_nearest[2]) {
    const int cell = triangulation_cell(t, at);
    for (int k = t->first[cell]; k < t->first[cell + 1]; k++) {
        const guint here = (guint)t->covering[k];
        if (!inside(t, here, at, ret_weight))
            continue;
        for (int c = 0; c < 3; c++)
            ret_index[c] = g_array_index(t->triangles, struct triangle, here).corner[c];
        ret_nearest[0] = at[0];
        ret_nearest[1] = at[1];
        return;
    }
    /* Finds the nearest point a + s (b − a), 0 ≤ s ≤ 1, over the border's edges a … b. */
    const int *hull = (const int *)t->hull->data;
    const gboolean open = t->triangles->len == 0 && t->hull->len > 1;
    double best = G_MAXDOUBLE;
    for (guint k = 0; k < t->hull->len - (open ? 1 : 0); k++) {
        const int i = hull[k], j = hull[(k + 1) % t->hull->len];
        const double *a = point(t, i), *b = point(t, j);
        const double along[2] = {b[0] - a[0], b[1] - a[1]};
        const double length = along[0] * along[0] + along[1] * along[1];
        const double scaled = (at[0] - a[0]) * along[0] + (at[1] - a[1]) * along[1];
        const double share = length > 0.0 ? CLAMP(scaled / length, 0.0, 1.0) : 0.0;
        const double x = a[0] + share * along[0] - at[0], y = a[1] + share * along[1] - at[1];
        if (x * x + y * y >= best)
            continue;
        best = x * x + y * y;
        ret_index[0] = ret_index[2] = i;
        ret_index[1] = j;
        ret_weight[0] = 1.0 - share;
        ret_weight[1] = share;
        ret_weight[2] = 0.0;
        for (int axis = 0; axis < 2; axis++)
            ret_nearest[axis] = (1.0 - share) * a[axis] + share * b[axis];
    }
}

const int *triangulation_corners(const Triangulation *t, int *ret_n) {
    *ret_n = (int)t->triangles->len;
    return (const int *)(const void *)t->triangles->data;
}
