/* The operator X (samples × n) maps n measured values to the samples of a grid. It is found in two
 * steps.
 *
 * A biharmonic spline interpolates the measured values over the hemisphere. S(ω) is its row of n
 * weights for the direction ω.
 *
 * Then least squares finds the samples whose bilinear interpolant B(ω) X is closest to the spline.
 * B(ω) is the row of weights of the samples.
 *   min ∫ ‖B(ω) X − S(ω)‖² dω + λ ‖X − S(grid)‖² + w · mean_i ‖B(ω_i) X − e_i‖²
 * ω_i are the measured directions, and e_i is row i of the identity. λ is NEAR, and w is MEASURED
 * or less. */
#include "direction_grid.h"

#include "base/data_error.h"
#include "base/direction.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#define LINEAR 4    /* number of linear terms: 1, x, y, z */
#define DENSE  3000 /* number of directions that sample the hemisphere evenly */
#define MOST   4096 /* maximum number of measured directions */
#define NEAR   1e-3 /* weight λ of the smooth interpolant at the samples themselves */

/* Weight w of the fit to the measured values, relative to the fit to the smooth interpolant (the
 * spline). Many measured directions lie midway between samples, for example many of
 * btf_directions_81() on a grid of 12. An exact fit to them makes the samples oscillate. gain_of()
 * tells by which factor a sample can exceed the largest measured value. While this factor is above
 * MOST_GAIN and w is above LEAST, w is halved. */
#define MEASURED  3.0
#define LEAST     0.05
#define MOST_GAIN 2.6

/* Computes Ω, the concentric map of Shirley and Chiu (1997) with ρ replaced by ρ √(2 − ρ²) for
 * equal solid angles. */
void direction_grid_direction(double s, double t, float ret[3]) {
    const double a = 2 * CLAMP(s, 0, 1) - 1, b = 2 * CLAMP(t, 0, 1) - 1;
    const gboolean across = fabs(a) > fabs(b);
    const double rho = across ? a : b;
    const double phi = rho == 0 ? 0 : across ? G_PI_4 * b / a : G_PI_2 - G_PI_4 * a / b;
    const double out = rho * sqrt(2 - rho * rho);
    ret[0] = (float)(out * cos(phi));
    ret[1] = (float)(out * sin(phi));
    ret[2] = (float)(1 - rho * rho);
}

void direction_grid_square(const float direction[3], double *ret_s, double *ret_t) {
    const double rho = sqrt(CLAMP(1 - (double)direction[2], 0, 1));
    double phi = atan2((double)direction[1], (double)direction[0]), a, b;
    if (phi < -G_PI_4)
        phi += 2 * G_PI;
    const int side = CLAMP((int)floor((phi + G_PI_4) / G_PI_2), 0, 3);
    const double along = rho, across = rho * (phi - side * G_PI_2) / G_PI_4;
    a = side == 0 ? along : side == 1 ? -across : side == 2 ? -along : across;
    b = side == 0 ? across : side == 1 ? along : side == 2 ? -across : -along;
    *ret_s = CLAMP((a + 1) / 2, 0, 1);
    *ret_t = CLAMP((b + 1) / 2, 0, 1);
}

/* u and v, 0 … 1, are the position within the cell of four samples. The bilinear weights are (1 −
 * u)(1 − v), u (1 − v), (1 − u) v and u v. */
void direction_grid_weights(int n_grid, const float direction[3], int ret_index[4],
                            float ret_weight[4]) {
    double s, t;
    direction_grid_square(direction, &s, &t);
    const double x = s * (n_grid - 1), y = t * (n_grid - 1);
    const int i = MIN((int)x, n_grid - 2), j = MIN((int)y, n_grid - 2);
    const float u = (float)(x - i), v = (float)(y - j);
    for (int k = 0; k < 4; k++) {
        ret_index[k] = (j + k / 2) * n_grid + i + k % 2;
        ret_weight[k] = (k % 2 ? u : 1 - u) * (k / 2 ? v : 1 - v);
    }
}

/* The smooth interpolant of values f_i at n measured directions ω_i is f(ω) = Σ_i a_i |ω − ω_i| +
 * b₀ + b·ω with Σ a_i (1, ω_i) = 0 (a biharmonic spline and a linear part). */
struct smooth {
    int n;
    float *directions; /* n × 3: x, y, z of the measured directions */
    double lowest;     /* z = cos θ of the lowest direction, but at least 0.001 */
    double *inverse;   /* (n + LINEAR) × n: maps values to the coefficients (a, b₀, b) */
    gboolean lights;
};

/* Sets ret (n + LINEAR) to |ω − ω_i| for all i, then 1, x, y, z of the direction ω. */
static void smooth_row(const struct smooth *smooth, const float *direction, double *ret) {
    for (int i = 0; i < smooth->n; i++) {
        const float *to = smooth->directions + (gsize)(3 * i);
        const double x = (double)direction[0] - to[0], y = (double)direction[1] - to[1];
        const double z = (double)direction[2] - to[2];
        ret[i] = sqrt(x * x + y * y + z * z);
    }
    ret[smooth->n] = 1;
    for (int k = 0; k < 3; k++)
        ret[smooth->n + 1 + k] = direction[k];
}

/* Solves [K P; Pᵀ 0] · inverse = [I; 0] with K_ij = |ω_i − ω_j| and P_i = (1, ω_i). Takes the
 * solution of least norm, which also exists for repeated, coplanar or single directions. Returns 0,
 * or the code with which LAPACK failed. */
static int smooth_init(struct smooth *smooth, const struct direction_list *list, gboolean lights) {
    const int n = (int)list->n, m = n + LINEAR;
    g_autofree double *a = g_new0(double, m *m), *singular = g_new(double, m);
    int rank;
    *smooth = (struct smooth){n, direction_list_vectors(list), 1, g_new0(double, m *n), lights};
    for (int i = 0; i < n; i++)
        smooth->lowest = MIN(smooth->lowest, smooth->directions[3 * i + 2]);
    smooth->lowest = MAX(smooth->lowest, 1e-3);
    for (int i = 0; i < n; i++) {
        smooth_row(smooth, smooth->directions + (gsize)(3 * i), a + (gsize)i * (gsize)m);
        for (int k = n; k < m; k++)
            a[(gsize)k * (gsize)m + (gsize)i] = a[(gsize)i * (gsize)m + (gsize)k];
        smooth->inverse[(gsize)i * (gsize)n + (gsize)i] = 1;
    }
    return LAPACKE_dgelsd(LAPACK_ROW_MAJOR, m, m, n, a, m, smooth->inverse, n, singular, 1e-7,
                          &rank);
}

static void smooth_clear(struct smooth *smooth) {
    g_free(smooth->directions);
    g_free(smooth->inverse);
}

/* Returns for each of count directions the weights of the n measured values in the interpolant
 * (count × n). A direction below the lowest measured one is raised to the elevation of the lowest
 * one. For lights, its weights are then multiplied by z / lowest, where z is cos θ of the
 * direction. */
static double *smooth_at(const struct smooth *smooth, const float *directions, int count) {
    const int m = smooth->n + LINEAR;
    g_autofree double *rows = g_new(double, (gsize)count *(gsize)m);
    double *ret = g_new(double, (gsize)count *(gsize)smooth->n);
    for (int i = 0; i < count; i++) {
        const float *d = directions + (gsize)(3 * i);
        const double low = smooth->lowest, out = hypot((double)d[0], (double)d[1]);
        const gboolean below = d[2] < low;
        const double scale = below ? sqrt(1 - low * low) / MAX(out, 1e-9) : 1;
        const float at[3] = {(float)(d[0] * scale), (float)(d[1] * scale),
                             below ? (float)low : d[2]};
        double *row = rows + (gsize)i * (gsize)m;
        smooth_row(smooth, at, row);
        if (below && smooth->lights)
            cblas_dscal(m, MAX(d[2], 0) / low, row, 1);
    }
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, count, smooth->n, m, 1, rows, m,
                smooth->inverse, smooth->n, 0, ret, smooth->n);
    return ret;
}

/* Adds the term weight · ‖bᵀX − target‖² to the normal equations of X: matrix += weight · b bᵀ,
 * right += weight · b · target. b holds the bilinear weights of the samples at a direction, and
 * target is a row of n values. */
static void add_equation(int n_grid, const float *direction, double weight, const double *target,
                         int n, double *matrix, double *right) {
    const int samples = n_grid * n_grid;
    int index[4];
    float share[4];
    direction_grid_weights(n_grid, direction, index, share);
    for (int a = 0; a < 4; a++) {
        for (int b = 0; b < 4; b++)
            matrix[(gsize)index[a] * (gsize)samples + (gsize)index[b]] +=
                weight * share[a] * share[b];
        cblas_daxpy(n, weight * share[a], target, 1, right + (gsize)index[a] * (gsize)n, 1);
    }
}

static float *grid_directions(int n_grid) {
    float *ret = g_new0(float, 3 * n_grid * n_grid);
    for (int i = 0; i < n_grid * n_grid; i++) {
        const int column = i % n_grid, row = i / n_grid;
        direction_grid_direction(column / (n_grid - 1.0), row / (n_grid - 1.0),
                                 ret + (gsize)(3 * i));
    }
    return ret;
}

/* Normal equations matrix · X = right. matrix: samples × samples; right and X: samples × n. */
struct equations {
    gsize samples, n;
    double *matrix, *right;
};

static struct equations equations_new(int n_grid, int n) {
    const gsize samples = (gsize)n_grid * (gsize)n_grid;
    return (struct equations){samples, (gsize)n, g_new0(double, samples *samples),
                              g_new0(double, samples *(gsize)n)};
}

static void equations_clear(struct equations *equations) {
    g_free(equations->matrix);
    g_free(equations->right);
}

/* Makes the terms that fit the bilinear grid to the smooth interpolant over the whole
 * hemisphere. */
static struct equations follow_smooth(const struct smooth *smooth, int n_grid) {
    struct equations ret = equations_new(n_grid, smooth->n);
    g_autofree float *dense = g_new(float, 3 * DENSE), *grid = grid_directions(n_grid);
    /* A Fibonacci spiral, z_i = 1 − (i + ½)/DENSE, φ_i = π (1 + √5)(i + ½). */
    for (int i = 0; i < DENSE; i++) {
        const double z = 1 - (i + 0.5) / DENSE, r = sqrt(1 - z * z);
        const double phi = G_PI * (1 + sqrt(5)) * (i + 0.5);
        dense[3 * i] = (float)(r * cos(phi));
        dense[3 * i + 1] = (float)(r * sin(phi));
        dense[3 * i + 2] = (float)z;
    }
    g_autofree double *at_dense = smooth_at(smooth, dense, DENSE);
    g_autofree double *at_grid = smooth_at(smooth, grid, (int)ret.samples);
    for (gsize i = 0; i < DENSE; i++)
        add_equation(n_grid, dense + 3 * i, 1.0 / DENSE, at_dense + i * ret.n, (int)ret.n,
                     ret.matrix, ret.right);
    for (gsize i = 0; i < ret.samples; i++) {
        const double near = NEAR / (double)ret.samples;
        ret.matrix[i * ret.samples + i] += near;
        cblas_daxpy((int)ret.n, near, at_grid + i * ret.n, 1, ret.right + i * ret.n, 1);
    }
    return ret;
}

/* Makes the terms that fit the bilinear grid to the measured values in the measured directions. */
static struct equations follow_measured(const struct smooth *smooth, int n_grid) {
    struct equations ret = equations_new(n_grid, smooth->n);
    g_autofree double *one = g_new0(double, ret.n);
    for (gsize i = 0; i < ret.n; i++) {
        one[i] = 1;
        add_equation(n_grid, smooth->directions + 3 * i, 1 / (double)ret.n, one, (int)ret.n,
                     ret.matrix, ret.right);
        one[i] = 0;
    }
    return ret;
}

/* Solves (A + w B) X = R_A + w R_B for X (samples × n) by Cholesky decomposition. A and R_A are the
 * equations of `smooth`, B and R_B are the equations of `measured`. */
static double *solve(const struct equations *smooth, const struct equations *measured,
                     double weight) {
    const gsize samples = smooth->samples, n = smooth->n;
    g_autofree double *matrix = g_memdup2(smooth->matrix, sizeof(double) * samples * samples);
    double *ret = g_memdup2(smooth->right, sizeof(double) * samples * n);
    cblas_daxpy((int)(samples * samples), weight, measured->matrix, 1, matrix, 1);
    cblas_daxpy((int)(samples * n), weight, measured->right, 1, ret, 1);
    LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', (int)samples, (int)n, matrix, (int)samples, ret, (int)n);
    return ret;
}

/* Returns the largest sum of the absolute values of a row of X. No sample can exceed the largest
 * absolute measured value by more than this factor. */
static double gain_of(const double *rows, gsize samples, gsize n) {
    double most = 0;
    for (gsize i = 0; i < samples; i++)
        most = MAX(most, cblas_dasum((int)n, rows + i * n, 1));
    return most;
}

static gboolean check_grid(const struct direction_list *list, int n_grid, gboolean lights,
                           GError **error) {
    const char *what = lights ? "lights" : "views";
    if (n_grid < DIRECTION_GRID_MIN || n_grid > DIRECTION_GRID_MAX)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the grid of directions has %d directions along a side, but must have %d to "
                    "%d; give another size",
                    n_grid, DIRECTION_GRID_MIN, DIRECTION_GRID_MAX);
    else if (list->n < 1)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the material has no %s, but a grid of directions needs at least one", what);
    else if (list->n > MOST)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the material has %zu %s, but a grid of directions can be computed from at "
                    "most %d; resample the material to fewer directions first",
                    list->n, what, MOST);
    else {
        for (gsize i = 0; i < list->n; i++) {
            const double theta = (double)list->theta_deg[i], phi = (double)list->phi_deg[i];
            if (isfinite(theta) && isfinite(phi) && fabs(theta) <= 90)
                continue;
            g_set_error(
                error, DATA_ERROR, DATA_ERROR_INVALID,
                "direction %zu of the %s, counted from 0, is θ %g°, φ %g°, but a grid of "
                "directions needs finite angles and θ up to 90°; correct the directions, or "
                "compress without --grid",
                i, what, theta, phi);
            return FALSE;
        }
        return TRUE;
    }
    return FALSE;
}

/* Solves with w = MEASURED first. Then halves w while the samples oscillate and w is above
 * LEAST. */
float *direction_grid_operator(const struct direction_list *list, int n_grid, gboolean lights,
                               GError **error) {
    struct smooth smooth = {0};
    if (!check_grid(list, n_grid, lights, error))
        return NULL;
    const int info = smooth_init(&smooth, list, lights);
    if (info != 0) {
        smooth_clear(&smooth);
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "no grid can be computed from the %zu directions of the %s (LAPACK's dgelsd "
                    "failed with code %d); resample the session to other directions first (mesorig "
                    "resample)",
                    list->n, lights ? "lights" : "views", info);
        return NULL;
    }
    struct equations everywhere = follow_smooth(&smooth, n_grid);
    struct equations measured = follow_measured(&smooth, n_grid);
    const gsize samples = everywhere.samples, values = everywhere.n;
    smooth_clear(&smooth);
    double *rows = solve(&everywhere, &measured, MEASURED);
    for (double w = MEASURED; w > LEAST && gain_of(rows, samples, values) > MOST_GAIN; w /= 2) {
        g_free(rows);
        rows = solve(&everywhere, &measured, w / 2);
    }
    equations_clear(&everywhere);
    equations_clear(&measured);
    float *ret = g_new(float, samples *values);
    for (gsize i = 0; i < samples * values; i++)
        ret[i] = (float)rows[i];
    g_free(rows);
    return ret;
}

struct direction_list direction_grid_samples(int n_grid) {
    struct direction_list ret = direction_list_new((gsize)n_grid * (gsize)n_grid);
    g_autofree float *grid = grid_directions(n_grid);
    for (gsize i = 0; i < ret.n; i++) {
        const float *d = grid + 3 * i;
        ret.theta_deg[i] = acosf(CLAMP(d[2], -1, 1)) * 180 / (float)G_PI;
        ret.phi_deg[i] = atan2f(d[1], d[0]) * 180 / (float)G_PI;
    }
    return ret;
}
