/* Minimises Σ w_i² |r_i(x)|² / σ² + Σ ((x_j − known_j) / known_sigma_j)². x are the parameters, r_i
 * are the residuals of observation i, and σ is the scale of the residuals relative to their
 * expected size. Each round runs Levenberg-Marquardt on the normal equations, with m residuals and
 * n parameters.
 *
 * The weights w are estimated again in each round. In the first rounds they are soft, 1 / √(1 +
 * (|r| / (SOFT s))²) with the robust scale s. In the last rounds they are 0 or 1. */
#include "fit.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SOFT_ROUNDS 5 /* first rounds, with soft (Cauchy-like) weights */
#define HARD_ROUNDS 3 /* last rounds, with outliers rejected */
#define SOFT        2.5
#define SINGULAR    1e-12 /* smallest relative pivot of the scaled normal equations */
#define CONVERGED   1e-10
#define STEPS       60
/* √ε of a double: step of forward differences of x, relative to max(|x|, 1) */
#define DIFFERENCE  1.5e-8
#define MAX_DAMPING 1e8
/* Lower bound of the scale of the residuals, relative to their expected size. Much smaller
 * residuals are rounding errors. If the scale were as small as rounding errors, priors would have
 * no weight. */
#define MIN_SIGMA 1e-3

struct work {
    const struct fit *fit;
    double *weights; /* one per observation */
    double sigma;    /* scale of the residuals relative to their expected size */
    int m, n;
    int n_depends;
    const int *depends;
    double *f, *moved, *at;
    double *rows; /* Jacobian, m × n_depends */
};

/* Returns the residual of the prior of parameter i. */
static double known_residual(const struct fit *fit, const double *x, int i) {
    return fit->known_sigma && fit->known_sigma[i] > 0
               ? (x[i] - fit->known[i]) / fit->known_sigma[i]
               : 0;
}

/* Computes the residuals f. Returns the weighted sum of squares of residuals and priors, or
 * G_MAXDOUBLE if it is not finite. */
static double evaluate(const struct work *work, const double *x, double *f) {
    const struct fit *fit = work->fit;
    double sum = 0;
    fit->residuals(x, f, fit->data);
    for (int i = 0; i < work->m; i++) {
        const double r = f[i] * work->weights[i / fit->dimension] / work->sigma;
        sum += r * r;
    }
    for (int i = 0; i < work->n; i++)
        sum += pow(known_residual(fit, x, i), 2);
    return isfinite(sum) ? sum : G_MAXDOUBLE;
}

/* Computes the Jacobian by forward differences. All parameters of one column of `depends` are
 * changed at the same time. */
static void differentiate(const struct work *work, const double *x) {
    const struct fit *fit = work->fit;
    const int n = work->n_depends;
    g_autofree int *column = g_new(int, work->n);
    for (int j = 0; j < work->n; j++)
        column[j] = -1;
    for (int i = 0; i < fit->n_observations * n; i++)
        if (work->depends[i] >= 0)
            column[work->depends[i]] = i % n;
    for (int k = 0; k < n; k++) {
        memcpy(work->at, x, sizeof(double) * (gsize)work->n);
        for (int j = 0; j < work->n; j++)
            if (column[j] == k)
                work->at[j] += DIFFERENCE * MAX(fabs(x[j]), 1);
        fit->residuals(work->at, work->moved, fit->data);
        for (int i = 0; i < work->m; i++) {
            const int j = work->depends[i / fit->dimension * n + k];
            work->rows[i * n + k] =
                j < 0 ? 0 : (work->moved[i] - work->f[i]) / (work->at[j] - x[j]);
        }
    }
}

/* Computes h = Jᵀ W J / σ² and g = −Jᵀ W f / σ², and adds the priors to both. Both triangles of h
 * are filled. */
static void normal_equations(const struct work *work, const double *x, double *h, double *g) {
    const struct fit *fit = work->fit;
    const int n = work->n, k = work->n_depends;
    memset(h, 0, sizeof(double) * (gsize)n * (gsize)n);
    memset(g, 0, sizeof(double) * (gsize)n);
    for (int i = 0; i < work->m; i++) {
        const double *row = work->rows + i * k;
        const int *of = work->depends + i / fit->dimension * k;
        const double weight = pow(work->weights[i / fit->dimension] / work->sigma, 2);
        for (int a = 0; a < k && weight > 0; a++) {
            if (of[a] < 0)
                continue;
            g[of[a]] -= weight * row[a] * work->f[i];
            for (int b = 0; b < k; b++)
                if (of[b] >= 0)
                    h[of[a] * n + of[b]] += weight * row[a] * row[b];
        }
    }
    for (int j = 0; j < n; j++)
        if (fit->known_sigma && fit->known_sigma[j] > 0) {
            h[j * n + j] += 1 / (fit->known_sigma[j] * fit->known_sigma[j]);
            g[j] -= known_residual(fit, x, j) / fit->known_sigma[j];
        }
}

/* Runs Levenberg-Marquardt with the present weights. Stops when a step decreases χ² by less than
 * the fraction CONVERGED, when no step decreases χ², or after STEPS steps. */
static void do_solve(const struct work *work, double *x) {
    const int n = work->n;
    g_autofree double *h = g_new0(double, (gsize)n *(gsize)n), *g = g_new0(double, n),
                      *next = g_new0(double, n);
    double damping = 1e-6, now = evaluate(work, x, work->f);
    for (int i = 0; i < STEPS; i++) {
        differentiate(work, x);
        normal_equations(work, x, h, g);
        double then = G_MAXDOUBLE;
        while (damping < MAX_DAMPING) {
            /* One damped step (h + damping · diag h) dx = g. */
            g_autofree double *a = g_memdup2(h, sizeof(double) * (gsize)n * (gsize)n);
            g_autofree double *b = g_memdup2(g, sizeof(double) * (gsize)n);
            for (int j = 0; j < n; j++)
                a[j * n + j] = h[j * n + j] > 0 ? h[j * n + j] * (1 + damping) : 1;
            if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', n, 1, a, n, b, n) == 0) {
                for (int j = 0; j < n; j++)
                    next[j] = x[j] + b[j];
                then = evaluate(work, next, work->moved);
            }
            if (then < now)
                break;
            damping = MAX(damping, 1e-9) * 10;
        }
        if (!(then < now))
            return;
        const gboolean settled = now - then < CONVERGED * now;
        memcpy(x, next, sizeof(double) * (gsize)n);
        memcpy(work->f, work->moved, sizeof(double) * (gsize)work->m);
        now = then;
        damping = MAX(damping / 10, 1e-12);
        if (settled)
            return;
    }
}

static double size_of(const struct fit *fit, const double *residuals, int i) {
    double sum = 0;
    for (int k = 0; k < fit->dimension; k++)
        sum += residuals[i * fit->dimension + k] * residuals[i * fit->dimension + k];
    return isfinite(sum) ? sqrt(sum) : FIT_LOST;
}

int fit_compare(gconstpointer a, gconstpointer b) {
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

int fit_compare_floats(gconstpointer a, gconstpointer b) {
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* Computes the weights from the residuals. The robust scale is median |r| / 0.6745 in one
 * dimension and median |r| / 1.1774 in two (medians of normal deviates). The scale is at least
 * MIN_SIGMA. If hard is set, the weight is 1 up to fit->reject scales and otherwise 0. If hard
 * is not set, the weight is 1 / √(1 + (|r| / (SOFT scale))²). */
static void weigh(struct work *work, gboolean hard) {
    const struct fit *fit = work->fit;
    g_autofree double *sizes = g_new(double, fit->n_observations);
    for (int i = 0; i < fit->n_observations; i++)
        sizes[i] = size_of(fit, work->f, i);
    qsort(sizes, (gsize)fit->n_observations, sizeof *sizes, fit_compare);
    const double median = sizes[fit->n_observations / 2];
    work->sigma = MAX(median / (fit->dimension == 1 ? 0.6745 : 1.1774), MIN_SIGMA);
    for (int i = 0; i < fit->n_observations; i++) {
        double times = size_of(fit, work->f, i) / work->sigma;
        work->weights[i] =
            hard ? times <= fit->reject : 1 / sqrt(1 + times * times / (SOFT * SOFT));
    }
}

/* Returns the inverse of h, by Cholesky decomposition with pivoting. The rows of undetermined
 * parameters are 0. *ret_undetermined gets one of these parameters, or −1 if there is none. */
static double *invert(int n, const double *h, int *ret_undetermined) {
    g_autofree double *a = g_new(double, (gsize)n *(gsize)n), *scale = g_new0(double, n);
    g_autofree lapack_int *pivots = g_new(lapack_int, n);
    double *inverse = g_new0(double, (gsize)n *(gsize)n);
    lapack_int rank = 0;
    for (int j = 0; j < n; j++)
        scale[j] = h[j * n + j] > 0 ? 1 / sqrt(h[j * n + j]) : 0;
    for (int i = 0; i < n * n; i++)
        a[i] = h[i] * scale[i / n] * scale[i % n];
    LAPACKE_dpstrf(LAPACK_COL_MAJOR, 'U', n, a, n, pivots, &rank, SINGULAR);
    *ret_undetermined = -1;
    for (int j = n - 1; j >= rank; j--)
        *ret_undetermined = pivots[j] - 1;
    if (rank == 0 || LAPACKE_dpotri(LAPACK_COL_MAJOR, 'U', rank, a, n) != 0)
        return inverse;
    for (int i = 0; i < rank; i++)
        for (int j = 0; j < rank; j++) {
            const int p = pivots[i] - 1, q = pivots[j] - 1;
            inverse[p * n + q] = a[MAX(i, j) * n + MIN(i, j)] * scale[p] * scale[q];
        }
    return inverse;
}

/* Computes the final covariance. This is done twice: first to find σ² = χ² per degree of freedom of
 * the observations used, then with the errors of the observations scaled by σ. The scale determines
 * the weight of the observations relative to the priors. */
static void finish(struct work *work, double *x, struct fit_result *ret) {
    const struct fit *fit = work->fit;
    const int n = work->n;
    g_autofree double *h = g_new0(double, (gsize)n *(gsize)n), *g = g_new0(double, n);
    double squares = 0;
    evaluate(work, x, work->f);
    ret->rejected = g_new0(guint8, fit->n_observations);
    for (int i = 0; i < fit->n_observations; i++) {
        ret->rejected[i] = work->weights[i] == 0;
        ret->n_used += !ret->rejected[i];
        squares += ret->rejected[i] ? 0 : pow(size_of(fit, work->f, i), 2);
    }
    for (int round = 0; round < 2; round++) {
        differentiate(work, x);
        normal_equations(work, x, h, g);
        g_free(ret->covariance);
        ret->covariance = invert(n, h, &ret->undetermined);
        /* The effective number of parameters that the observations, and not the priors, determine
         * is the trace of H⁻¹ JᵀJ. */
        double sum = 0;
        for (int j = 0; j < work->n; j++) {
            const double sigma = fit->known_sigma ? fit->known_sigma[j] : 0;
            const double left = sigma > 0 ? ret->covariance[j * work->n + j] / (sigma * sigma) : 0;
            sum += ret->covariance[j * work->n + j] > 0 ? 1 - MIN(left, 1) : 0;
        }
        const double freedom = ret->n_used * fit->dimension - sum;
        ret->degrees_of_freedom = (int)floor(freedom);
        ret->sigma = freedom > 0 ? sqrt(squares / freedom) : 0;
        work->sigma = MAX(ret->sigma, MIN_SIGMA);
    }
    if (ret->degrees_of_freedom <= 0 && ret->undetermined < 0)
        ret->undetermined = 0;
    ret->residuals = g_memdup2(work->f, sizeof(double) * (gsize)work->m);
}

gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret) {
    const int n = fit->n_parameters, m = fit->n_observations * fit->dimension;
    int n_known = 0;
    memset(ret, 0, sizeof *ret);
    for (int i = 0; fit->known_sigma && i < n; i++)
        n_known += fit->known_sigma[i] > 0;
    if (fit->n_observations < 1 || m + n_known <= n)
        return FALSE;
    const int n_depends = fit->depends ? fit->n_depends : n;
    const int *depends = fit->depends;
    g_autofree int *all = NULL;
    if (!depends) {
        depends = all = g_new0(int, (gsize)fit->n_observations *(gsize)n);
        for (int i = 0; i < fit->n_observations * n; i++)
            all[i] = i % n;
    }
    g_autofree double *weights = g_new(double, fit->n_observations), *f = g_new(double, m);
    g_autofree double *moved = g_new(double, m), *at = g_new0(double, n);
    g_autofree double *rows = g_new(double, (gsize)m *(gsize)n_depends);
    struct work work = {fit, weights, 1, m, n, n_depends, depends, f, moved, at, rows};
    fit->residuals(parameters, f, fit->data);
    for (int i = 0; i < m; i++)
        if (!isfinite(f[i]))
            return FALSE;
    /* The matrices are small: threads of OpenBLAS would wait for each other most of the time. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    for (int round = fit->is_near ? SOFT_ROUNDS : 0; round < SOFT_ROUNDS + HARD_ROUNDS; round++) {
        weigh(&work, round >= SOFT_ROUNDS);
        do_solve(&work, parameters);
    }
    finish(&work, parameters, ret);
    openblas_set_num_threads(threads);
    return TRUE;
}

void fit_result_clear(struct fit_result *result) {
    g_clear_pointer(&result->covariance, g_free);
    g_clear_pointer(&result->residuals, g_free);
    g_clear_pointer(&result->rejected, g_free);
}

double fit_error(const struct fit *fit, const struct fit_result *result, int parameter) {
    double variance = result->covariance[parameter * (fit->n_parameters + 1)];
    return variance > 0 ? sqrt(variance) : HUGE_VAL;
}
