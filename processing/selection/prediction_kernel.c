/* The covariance of pairs. Its constants are fitted by cross-validation. */
#include "prediction_private.h"

#include <cblas.h>
#include <lapacke.h>
#include <stdlib.h>
#include <string.h>

/* Limits of the fit of the constants. The fit uses at most FIT_ROWS rows, evenly spread, and
 * at most FIT_PAIRS pairs of neighbouring views, so that the pairs are as dense as all pairs.
 *
 * There are FIT_SWEEPS sweeps over all constants. A sweep multiplies or divides each constant by a
 * factor if that reduces the error. The factor is FIT_STEP in the first sweep, and the square root
 * of the previous factor in each following sweep. */
#define FIT_ROWS   64
#define FIT_PAIRS  500
#define FIT_SWEEPS 3
#define FIT_STEP   3.0

/* maximum number of pairs of a group that are left out together; larger groups are divided */
#define MAX_GROUP 64
/* up to this number of covariances are computed in the calling thread */
#define MAX_ALONE 1000000

static double distance(struct vec3 a, struct vec3 b) {
    return vec3_length(vec3_sub(a, b));
}

/* The factors of k (prediction.h) that depend only on two views or on two lights, for all pairs of
 * views and of lights. The terms of k are products of these factors. */
struct prediction_tables {
    /* n_views² each, in this order: c₂ exp(−d_v / a₂), c₃ exp(−d_v / a₃), c₄ exp(−d_v / b₄) */
    double *view2, *view3, *view4;
    /* n_lights² each, in this order: 1 + c₁ l·l', exp(−d_l / b₂), exp(−d_l / b₃) */
    double *light1, *light2, *light3;
};

static double *decay(const struct vec3 *at, int n, double length, double factor) {
    double *table = g_new(double, (gsize)n *(gsize)n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            table[i * n + j] = factor * exp(-distance(at[i], at[j]) / length);
    return table;
}

static void tables_make(const Prediction *prediction, struct prediction_tables *ret) {
    const double *c = prediction->constants;
    const int n = prediction->n_views, m = prediction->n_lights;
    ret->view2 = decay(prediction->views, n, c[PREDICTION_A2], c[PREDICTION_C2]);
    ret->view3 = decay(prediction->views, n, c[PREDICTION_A3], c[PREDICTION_C3]);
    ret->view4 = decay(prediction->views, n, c[PREDICTION_B4], c[PREDICTION_C4]);
    ret->light2 = decay(prediction->lights, m, c[PREDICTION_B2], 1);
    ret->light3 = decay(prediction->lights, m, c[PREDICTION_B3], 1);
    ret->light1 = g_new(double, (gsize)m *(gsize)m);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++)
            ret->light1[i * m + j] =
                1 + c[PREDICTION_C1] * vec3_dot(prediction->lights[i], prediction->lights[j]);
}

static void tables_clear(struct prediction_tables *tables) {
    g_free(tables->view2);
    g_free(tables->view3);
    g_free(tables->view4);
    g_free(tables->light1);
    g_free(tables->light2);
    g_free(tables->light3);
}

/* Returns the half vector of a view and a light, or the normal if they are opposite. */
static struct vec3 prediction_half(const Prediction *prediction, int pair) {
    const struct vec3 sum = vec3_add(prediction->views[pair / prediction->n_lights],
                                     prediction->lights[pair % prediction->n_lights]);
    return vec3_length(sum) > 1e-9 ? vec3_unit(sum) : vec3(0, 0, 1);
}

struct prediction_columns {
    const Prediction *prediction;
    const struct prediction_tables *tables;
    const int *a, *b;
    const struct vec3 *half_a;
    int n_a;
    double *ret;
};

static void prediction_column(int j, gpointer data) {
    const struct prediction_columns *job = data;
    const Prediction *prediction = job->prediction;
    const struct prediction_tables *t = job->tables;
    const int n_views = prediction->n_views, n_lights = prediction->n_lights;
    const int view = job->b[j] / n_lights, light = job->b[j] % n_lights;
    const struct vec3 half = prediction_half(prediction, job->b[j]);
    const double length = prediction->constants[PREDICTION_A4];
    double *column = job->ret + (gsize)j * (gsize)job->n_a;
    for (int i = 0; i < job->n_a; i++) {
        const int v = (job->a[i] / n_lights) * n_views + view;
        const int l = (job->a[i] % n_lights) * n_lights + light;
        column[i] = t->light1[l] + t->view2[v] * t->light2[l] + t->view3[v] * t->light3[l] +
                    t->view4[v] * exp(-distance(job->half_a[i], half) / length);
    }
}

void prediction_covariance(const Prediction *prediction, const int *a, int n_a, const int *b,
                           int n_b, double *ret) {
    struct prediction_tables tables;
    g_autofree struct vec3 *half_a = g_new(struct vec3, n_a);
    for (int i = 0; i < n_a; i++)
        half_a[i] = prediction_half(prediction, a[i]);
    tables_make(prediction, &tables);
    struct prediction_columns job = {prediction, &tables, a, b, half_a, n_a, ret};
    if ((gint64)n_a * n_b > MAX_ALONE)
        work_for_each(0, n_b, prediction_column, &job);
    else /* threads would cost more than they save */
        for (int j = 0; j < n_b; j++)
            prediction_column(j, &job);
    tables_clear(&tables);
}

void prediction_covariance_small(const Prediction *prediction, const int *pairs, int n,
                                 double *ret) {
    const double *c = prediction->constants;
    const int n_lights = prediction->n_lights;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const struct vec3 a = prediction->lights[pairs[i] % n_lights];
            const struct vec3 b = prediction->lights[pairs[j] % n_lights];
            const double v = distance(prediction->views[pairs[i] / n_lights],
                                      prediction->views[pairs[j] / n_lights]);
            const double l = distance(a, b);
            const double h = distance(prediction_half(prediction, pairs[i]),
                                      prediction_half(prediction, pairs[j]));
            ret[i * n + j] = 1 + c[PREDICTION_C1] * vec3_dot(a, b) +
                             c[PREDICTION_C2] * exp(-v / c[PREDICTION_A2] - l / c[PREDICTION_B2]) +
                             c[PREDICTION_C3] * exp(-v / c[PREDICTION_A3] - l / c[PREDICTION_B3]) +
                             c[PREDICTION_C4] * exp(-h / c[PREDICTION_A4] - v / c[PREDICTION_B4]) +
                             (i == j ? c[PREDICTION_NUGGET] : 0);
        }
}

gboolean prediction_left_out_weights(const Prediction *prediction, struct vec3 view,
                                     const struct vec3 *lights, int n, double *ret_weights) {
    Prediction of = *prediction;
    g_autofree struct vec3 *directions = g_memdup2(lights, sizeof *lights * (gsize)n);
    g_autofree int *pairs = g_new(int, n);
    of.n_views = 1;
    of.n_lights = n;
    of.views = &view;
    of.lights = directions;
    for (int i = 0; i < n; i++)
        pairs[i] = i;
    prediction_covariance_small(&of, pairs, n, ret_weights);
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', n, ret_weights, n) != 0 ||
        LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', n, ret_weights, n) != 0)
        return FALSE;
    for (int j = 0; j < n; j++) /* K⁻¹ is in the lower triangle, i ≥ j */
        for (int i = 0; i < j; i++)
            ret_weights[i + (gsize)n * (gsize)j] = ret_weights[j + (gsize)n * (gsize)i];
    for (int j = 0; j < n; j++) {
        double *column = ret_weights + (gsize)n * (gsize)j;
        const double diagonal = column[j];
        for (int i = 0; i < n; i++)
            column[i] = i == j ? 0 : -column[i] / diagonal;
    }
    return TRUE;
}

double prediction_prior_variance(const Prediction *prediction, int pair) {
    const double *c = prediction->constants;
    return 1 + c[PREDICTION_C1] + c[PREDICTION_C2] + c[PREDICTION_C3] + c[PREDICTION_C4] +
           c[PREDICTION_NUGGET];
}

/* Returns the number of pairs from index i of order on that belong to one group, at most MAX_GROUP.
 * order has indices into pairs, sorted by group. */
static int same_group(const Prediction *prediction, const int *pairs, int m, const int *order,
                      int i) {
    int n = 1;
    while (n < MAX_GROUP && i + n < m &&
           prediction->groups[pairs[order[i + n]]] == prediction->groups[pairs[order[i]]])
        n++;
    return n;
}

struct prediction_order {
    int group, index;
};

static int by_group(const void *a, const void *b) {
    const struct prediction_order *p = a, *q = b;
    return p->group != q->group ? (p->group > q->group) - (p->group < q->group)
                                : (p->index > q->index) - (p->index < q->index);
}

static int *sorted(const Prediction *prediction, const int *pairs, int m) {
    g_autofree struct prediction_order *keys = g_new(struct prediction_order, m);
    int *order = g_new(int, m);
    for (int i = 0; i < m; i++)
        keys[i] = (struct prediction_order){prediction->groups[pairs[i]], i};
    qsort(keys, (gsize)m, sizeof *keys, by_group);
    for (int i = 0; i < m; i++)
        order[i] = keys[i].index;
    return order;
}

void prediction_left_out(const Prediction *prediction, const int *pairs, int m,
                         const double *inverse, const double *rows, int n_rows, double *ret_errors,
                         double *ret_variances) {
    g_autofree int *order = sorted(prediction, pairs, m);
    double block[MAX_GROUP * MAX_GROUP];
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n_rows, m, m, 1, rows, m, inverse, m, 0,
                ret_errors, m);
    for (int i = 0, n; i < m; i += n) {
        n = same_group(prediction, pairs, m, order, i);
        for (int j = 0; j < n; j++)
            for (int k = 0; k < n; k++)
                block[j * n + k] = inverse[(gsize)order[i + j] * (gsize)m + (gsize)order[i + k]];
        if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', n, block, n) != 0 ||
            LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', n, block, n) != 0)
            /* the matrix is positive definite, except for rounding errors */
            memset(block, 0, sizeof block);
        for (int j = 0; j < n; j++)
            ret_variances[order[i + j]] = block[j * n + j];
        for (int r = 0; r < n_rows; r++) {
            double *row = ret_errors + (gsize)r * (gsize)m, out[MAX_GROUP] = {0};
            for (int j = 0; j < n; j++)
                for (int k = 0; k < n; k++)
                    out[j] += block[MIN(j, k) * n + MAX(j, k)] * row[order[i + k]];
            for (int j = 0; j < n; j++)
                row[order[i + j]] = out[j];
        }
    }
}

/* Returns the sum of squared errors of cross-validation, or INFINITY for constants that cannot be
 * used. */
static double prediction_fit_error(const Prediction *prediction, const int *pairs, int m,
                                   const double *rows, const double *g, int n_rows) {
    g_autofree double *k = g_new(double, (gsize)m *(gsize)m);
    g_autofree double *errors = g_new(double, (gsize)n_rows *(gsize)m), *v = g_new(double, m);
    prediction_covariance(prediction, pairs, m, pairs, m, k);
    for (int i = 0; i < m; i++)
        k[(gsize)i * (gsize)m + (gsize)i] += prediction->constants[PREDICTION_NUGGET];
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', m, k, m) != 0 ||
        LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', m, k, m) != 0)
        return INFINITY;
    for (gsize i = 0; i < (gsize)m; i++)
        for (gsize j = 0; j < i; j++)
            k[i * (gsize)m + j] = k[j * (gsize)m + i];
    prediction_left_out(prediction, pairs, m, k, rows, n_rows, errors, v);
    double sum = 0;
    for (gsize i = 0; i < (gsize)n_rows * (gsize)m; i++)
        sum += errors[i] * errors[i] * g[i] * g[i];
    return sum;
}

struct prediction_azimuth {
    double off;
    int index;
};

static int by_azimuth(const void *a, const void *b) {
    const struct prediction_azimuth *p = a, *q = b;
    return p->off != q->off ? (p->off > q->off) - (p->off < q->off)
                            : (p->index > q->index) - (p->index < q->index);
}

/* Returns indices into measured of at most FIT_PAIRS pairs. Their views are those nearest in
 * azimuth to +x or +y, so that the pairs are as dense as all pairs. Two azimuths are used, because
 * brushed metal looks different in them. */
static int *fit_pairs(const Prediction *prediction, int *ret_n) {
    const int m = prediction->n_measured, n = MIN(m, FIT_PAIRS);
    g_autofree struct prediction_azimuth *keys = g_new(struct prediction_azimuth, m);
    int *indices = g_new(int, n);
    for (int i = 0; i < m; i++) {
        const struct vec3 view = prediction->views[prediction->measured[i] / prediction->n_lights];
        const double off[] = {fabs(atan2(view.y, view.x)), fabs(atan2(view.x, view.y))};
        keys[i] = (struct prediction_azimuth){fmin(off[0], off[1]), i};
    }
    qsort(keys, (gsize)m, sizeof *keys, by_azimuth);
    for (int i = 0; i < n; i++)
        indices[i] = keys[i].index;
    *ret_n = n;
    return indices;
}

gboolean prediction_fit(Prediction *prediction, const double *rows, const double *g, int n_rows,
                        const struct work *work, GError **error) {
    static const double least[] = {1e-3, 1e-4, 0.1, 0.1, 1e-4, 0.05, 0.05, 1e-4, 0.02, 0.1, 1e-5};
    static const double most[] = {100, 100, 10, 20, 100, 3, 5, 100, 3, 20, 0.3};
    G_STATIC_ASSERT(G_N_ELEMENTS(least) == PREDICTION_CONSTANTS);
    int m;
    const int n = MIN(n_rows, FIT_ROWS);
    g_autofree int *indices = fit_pairs(prediction, &m), *pairs = g_new(int, m);
    g_autofree double *values = g_new(double, (gsize)n *(gsize)m);
    g_autofree double *means = g_new0(double, (gsize)n *(gsize)m);
    for (int i = 0; i < m; i++)
        pairs[i] = prediction->measured[indices[i]];
    for (int r = 0; r < n; r++)
        for (int i = 0; i < m; i++) {
            const gsize from =
                (gsize)(r * (gint64)n_rows / n) * (gsize)prediction->n_measured + (gsize)indices[i];
            values[(gsize)r * (gsize)m + (gsize)i] = rows[from];
            means[(gsize)r * (gsize)m + (gsize)i] = g[from];
        }
    double *c = prediction->constants, step = FIT_STEP;
    double best = prediction_fit_error(prediction, pairs, m, values, means, n);
    const gint64 begun_us = g_get_monotonic_time();
    for (int sweep = 0; sweep < FIT_SWEEPS; sweep++, step = sqrt(step))
        for (int i = 0; i < PREDICTION_CONSTANTS; i++) {
            if (!work_tell(work, "prediction", sweep * PREDICTION_CONSTANTS + i,
                           FIT_SWEEPS * PREDICTION_CONSTANTS, begun_us, error))
                return FALSE;
            const double before = c[i];
            double at = before;
            for (int side = 0; side < 2 && at == before; side++) {
                c[i] = CLAMP(side ? before / step : before * step, least[i], most[i]);
                const double now = prediction_fit_error(prediction, pairs, m, values, means, n);
                if (now < best) {
                    best = now;
                    at = c[i];
                }
            }
            c[i] = at;
        }
    return TRUE;
}
