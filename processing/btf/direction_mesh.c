/* The gradient g_k of the values f at direction k is linear in f. A mesh stores its weights s_ki ∈
 * ℝ² of the differences to the neighbours i: g_k = Σ_i s_ki (f_i − f_k). */
#include "direction_mesh.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "directions/triangulation.h"

/* points of the plane closer than this (¼° at the plane's centre) count as one direction */
#define TOGETHER (0.25 * G_PI / 180 / 2)
/* triangles whose height over the longest side is at most this share of that side are dropped */
#define FLAT 0.02
/* maximum distance of extrapolation from a triangle, relative to its height */
#define MAX_AWAY 0.5
#define AROUND   20   /* maximum number of neighbours in the fit of a slope */
#define TERMS    5    /* number of terms of a quadric without its constant */
#define RANK     0.02 /* singular values below this share of the largest one count as 0 */
#define ROUNDING 1e-9

/* Four values that one instruction adds or multiplies. The values need not be aligned. */
typedef float lanes __attribute__((vector_size(16), aligned(4)));

struct triangle {
    int corner[3]; /* counter-clockwise */
};

struct slope { /* the weights with which the gradient at one direction is computed */
    int n, index[AROUND];
    /* weights s of (neighbour − own value); n is 0 if there is no fit */
    float x[AROUND], y[AROUND];
};

struct DirectionMesh {
    int n;
    gboolean lights;
    double *points; /* n × 2, as seen from the centre of the sample */
    gboolean *used;
    GArray *triangles;
    struct slope *slopes; /* n */
};

/* Projects stereographically: (x, y) / (1 + z), with z ≥ 0. */
void direction_mesh_point(struct vec3 direction, double ret[2]) {
    const double scale = 1 / (1 + MAX(direction.z, 0));
    ret[0] = direction.x * scale;
    ret[1] = direction.y * scale;
}

/* Returns z = cos θ of a projected direction, (1 − r²) / (1 + r²). */
static double cosine(const double point[2]) {
    const double r2 = point[0] * point[0] + point[1] * point[1];
    return (1 - r2) / (1 + r2);
}

static double apart(const double *a, const double *b) {
    return hypot(a[0] - b[0], a[1] - b[1]);
}

/* Returns twice the signed area of a triangle, positive if counter-clockwise. */
static double area(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static void triangulate(DirectionMesh *mesh) {
    g_autofree double *points = g_new(double, 2 * (gsize)mesh->n + 1);
    g_autofree int *index = g_new(int, (gsize)mesh->n + 1);
    int n = 0, n_triangles;
    for (int i = 0; i < mesh->n; i++)
        if (mesh->used[i]) {
            memcpy(points + 2 * (gsize)n, mesh->points + 2 * (gsize)i, 2 * sizeof *points);
            index[n++] = i;
        }
    if (n < 3)
        return;
    Triangulation *triangulation = triangulation_new(points, n);
    const int *corners = triangulation_corners(triangulation, &n_triangles);
    for (int t = 0; t < n_triangles; t++) {
        const int *c = corners + (gsize)(3 * t);
        const struct triangle triangle = {{index[c[0]], index[c[1]], index[c[2]]}};
        const double *p[3];
        for (int k = 0; k < 3; k++)
            p[k] = points + (gsize)(2 * c[k]);
        const double longest = MAX(apart(p[0], p[1]), MAX(apart(p[1], p[2]), apart(p[2], p[0])));
        if (area(p[0], p[1], p[2]) > FLAT * longest * longest)
            g_array_append_val(mesh->triangles, triangle);
    }
    triangulation_free(triangulation);
}

/* Extends a set of directions by all directions that share a triangle with a direction of the
 * set. */
static void spread(const DirectionMesh *mesh, guint8 *within) {
    g_autofree guint8 *before = g_memdup2(within, (gsize)mesh->n);
    for (guint t = 0; t < mesh->triangles->len; t++) {
        const int *c = g_array_index(mesh->triangles, struct triangle, t).corner;
        if (before[c[0]] || before[c[1]] || before[c[2]])
            within[c[0]] = within[c[1]] = within[c[2]] = 1;
    }
}

struct near {
    int index;
    double distance;
};

static int by_distance(const void *a, const void *b) {
    const struct near *x = a, *y = b;
    return x->distance != y->distance ? (x->distance < y->distance ? -1 : 1) : x->index - y->index;
}

/* Fits the gradient at direction `at`. The quadric through the direction's own value is fitted
 * to the differences d_i to its n neighbours at (x, y):
 *   min Σ_i w_i² (gx·x + gy·y + hxx·x² + hxy·xy + hyy·y² − d_i)²,   w_i = 1 / distance,
 * with the least norm. The solution is linear in d. Only its first two rows, gx and gy, are
 * stored. The neighbours are the nearest AROUND of the directions within two triangles. */
static void fit_slope(DirectionMesh *mesh, int at) {
    g_autofree guint8 *within = g_new0(guint8, mesh->n);
    g_autofree struct near *around = g_new(struct near, mesh->n);
    const double *own = mesh->points + (gsize)(2 * at);
    double a[AROUND * TERMS], b[AROUND * AROUND] = {0}, singular[TERMS];
    int n = 0, rank;
    within[at] = 1;
    spread(mesh, within);
    spread(mesh, within);
    for (int i = 0; i < mesh->n; i++)
        if (within[i] && i != at)
            around[n++] = (struct near){i, apart(mesh->points + (gsize)(2 * i), own)};
    if (n < TERMS)
        return;
    qsort(around, (gsize)n, sizeof *around, by_distance);
    n = MIN(n, AROUND);
    const double unit = around[n - 1].distance;
    for (int i = 0; i < n; i++) {
        const double *p = mesh->points + (gsize)(2 * around[i].index);
        const double x = (p[0] - own[0]) / unit, y = (p[1] - own[1]) / unit;
        const double terms[TERMS] = {x, y, x * x, x * y, y * y};
        const double weight = unit / around[i].distance;
        for (int k = 0; k < TERMS; k++)
            a[i * TERMS + k] = weight * terms[k];
        b[i * AROUND + i] = weight;
    }
    if (LAPACKE_dgelsd(LAPACK_ROW_MAJOR, n, TERMS, n, a, TERMS, b, AROUND, singular, RANK, &rank))
        return;
    struct slope *ret = &mesh->slopes[at];
    ret->n = n;
    for (int i = 0; i < n; i++) {
        ret->index[i] = around[i].index;
        ret->x[i] = (float)(b[i] / unit);
        ret->y[i] = (float)(b[AROUND + i] / unit);
    }
}

DirectionMesh *direction_mesh_new(const struct vec3 *directions, int n, int skip, gboolean lights) {
    DirectionMesh *mesh = g_new0(DirectionMesh, 1);
    *mesh = (DirectionMesh){.n = n,
                            .lights = lights,
                            .points = g_new(double, 2 * (gsize)n),
                            .used = g_new0(gboolean, n),
                            .triangles = g_array_new(FALSE, FALSE, sizeof(struct triangle)),
                            .slopes = g_new0(struct slope, n)};
    for (int i = 0; i < n; i++)
        direction_mesh_point(directions[i], mesh->points + 2 * (gsize)i);
    /* Directions that coincide with an earlier one are not used. */
    for (int i = 0; i < n; i++) {
        mesh->used[i] = i != skip;
        for (int k = 0; k < i && mesh->used[i]; k++)
            mesh->used[i] = !mesh->used[k] || apart(mesh->points + (gsize)(2 * i),
                                                    mesh->points + (gsize)(2 * k)) > TOGETHER;
    }
    triangulate(mesh);
    for (int i = 0; i < n; i++)
        if (mesh->used[i])
            fit_slope(mesh, i);
    return mesh;
}

void direction_mesh_free(DirectionMesh *mesh) {
    if (!mesh)
        return;
    g_free(mesh->points);
    g_free(mesh->used);
    g_array_unref(mesh->triangles);
    g_free(mesh->slopes);
    g_free(mesh);
}

/* Computes barycentric weights of a point. Returns the smallest weight, which is negative outside
 * of the triangle. Returns −G_MAXDOUBLE for a triangle that the moved corners have turned over. */
static double weigh(const DirectionMesh *mesh, const double *points, int triangle,
                    const double at[2], double ret[3]) {
    const int *corner = g_array_index(mesh->triangles, struct triangle, triangle).corner;
    const double *a = points + (gsize)(2 * corner[0]), *b = points + (gsize)(2 * corner[1]);
    const double *c = points + (gsize)(2 * corner[2]), whole = area(a, b, c);
    if (!(whole > 0))
        return -G_MAXDOUBLE;
    ret[0] = area(b, c, at) / whole;
    ret[1] = area(c, a, at) / whole;
    ret[2] = 1 - ret[0] - ret[1];
    return MIN(ret[0], MIN(ret[1], ret[2]));
}

/* In each triangle the direction has three barycentric weights. Sorts the triangles by the smallest
 * of the three, the largest value first. The first triangle most likely contains the direction. */
void direction_mesh_guess(const DirectionMesh *mesh, struct vec3 direction,
                          struct direction_guess *ret) {
    const int n = (int)mesh->triangles->len;
    g_autofree struct near *list = g_new(struct near, (gsize)n + 1);
    double at[2], weights[3];
    direction_mesh_point(direction, at);
    for (int t = 0; t < n; t++)
        list[t] = (struct near){t, -weigh(mesh, mesh->points, t, at, weights)};
    qsort(list, (gsize)n, sizeof *list, by_distance);
    ret->n = MIN(n, DIRECTION_MESH_GUESSES);
    for (int k = 0; k < ret->n; k++)
        ret->triangle[k] = list[k].index;
}

/* Returns the triangle that contains a point, and its weights as ret. If no triangle contains the
 * point, returns the triangle whose smallest weight is largest. Returns −1 if there are no
 * triangles, or if all are turned over. */
static int find(const DirectionMesh *mesh, const double *points, const double at[2],
                const struct direction_guess *guess, double ret[3]) {
    const int n = (int)mesh->triangles->len;
    double best = -G_MAXDOUBLE, weights[3];
    int found = -1;
    for (int k = 0; k < guess->n + n && best < -ROUNDING; k++) {
        const int t = k < guess->n ? guess->triangle[k] : k - guess->n;
        const double inside = weigh(mesh, points, t, at, weights);
        if (inside <= best)
            continue;
        best = inside;
        found = t;
        memcpy(ret, weights, sizeof weights);
    }
    return found;
}

/* Limits extrapolation. Weights below −MAX_AWAY are raised to −MAX_AWAY, and the positive ones
 * are scaled so that the sum stays 1. Returns whether any weight was limited. */
static gboolean limit_weights(double weights[3]) {
    double positive = 0, negative = 0;
    gboolean clamped = FALSE;
    for (int k = 0; k < 3; k++) {
        clamped |= weights[k] < -MAX_AWAY;
        weights[k] = MAX(weights[k], -MAX_AWAY);
        positive += MAX(weights[k], 0);
        negative += MIN(weights[k], 0);
    }
    for (int k = 0; clamped && k < 3; k++)
        if (weights[k] > 0)
            weights[k] *= (1 - negative) / positive;
    return clamped;
}

/* The interpolated value is f(x) = Σ_k b_k (f_k + ½ g_k · (x − x_k)), so that weight_k = b_k and
 * along_k = ½ (x − x_k). Beyond the limit of extrapolation, f(x) of lights is multiplied by cos θ
 * at the point over cos θ at the limit, because reflectance contains n·l. */
void direction_mesh_share(const DirectionMesh *mesh, const double *points, const double at[2],
                          const struct direction_guess *guess, struct direction_share *ret) {
    double weights[3], end[2] = {0}, sum[2] = {0}, best = G_MAXDOUBLE;
    const int triangle = find(mesh, points, at, guess, weights);
    if (triangle < 0) {
        *ret = (struct direction_share){.weight = {1}, .clamped = TRUE};
        for (int i = 0; i < mesh->n; i++) {
            const double distance = apart(points + (gsize)(2 * i), at);
            if (!mesh->used[i] || distance >= best)
                continue;
            best = distance;
            ret->corner[0] = ret->corner[1] = ret->corner[2] = i;
        }
    } else {
        const int *corner = g_array_index(mesh->triangles, struct triangle, triangle).corner;
        ret->clamped = limit_weights(weights);
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 2; axis++)
                end[axis] += weights[k] * points[2 * corner[k] + axis];
        for (int k = 0; k < 3; k++) {
            ret->corner[k] = corner[k];
            ret->weight[k] = (float)weights[k];
            for (int axis = 0; axis < 2; axis++)
                ret->along[k][axis] = (float)(0.5 * (end[axis] - points[2 * corner[k] + axis]));
        }
    }
    if (!ret->clamped || !mesh->lights)
        return;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 2; axis++)
            sum[axis] += (double)ret->weight[k] * points[2 * ret->corner[k] + axis];
    const double fade = cosine(at) / MAX(cosine(sum), 1e-3);
    for (int k = 0; k < 3; k++)
        ret->weight[k] *= (float)CLAMP(fade, 0, 1);
}

void direction_mesh_slopes(const DirectionMesh *mesh, const float *values, int row, float *ret) {
    for (int i = 0; i < mesh->n; i++) {
        const struct slope *slope = &mesh->slopes[i];
        const float *own = values + (gsize)i * (gsize)row;
        float *x = ret + 2 * (gsize)i * (gsize)row, *y = x + row;
        memset(x, 0, 2 * sizeof(float) * (gsize)row);
        for (int k = 0; k < slope->n; k++) {
            const float *other = values + (gsize)slope->index[k] * (gsize)row;
            for (int c = 0; c < row; c += 4) {
                const lanes step = *(const lanes *)(other + c) - *(const lanes *)(own + c);
                *(lanes *)(x + c) += slope->x[k] * step;
                *(lanes *)(y + c) += slope->y[k] * step;
            }
        }
    }
}

/* Expands g_k = Σ_i s_i (f_i − f_k) into weights of the values f. */
void direction_mesh_weights(const DirectionMesh *mesh, const struct direction_share *share,
                            float *ret_weights) {
    for (int k = 0; k < 3; k++) {
        const struct slope *slope = &mesh->slopes[share->corner[k]];
        ret_weights[share->corner[k]] += share->weight[k];
        for (int i = 0; i < slope->n; i++) {
            const float weight = share->weight[k] * (share->along[k][0] * slope->x[i] +
                                                     share->along[k][1] * slope->y[i]);
            ret_weights[slope->index[i]] += weight;
            ret_weights[share->corner[k]] -= weight;
        }
    }
}
