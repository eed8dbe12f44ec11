#include "fit.h"

#include <cminpack.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SOFT_ROUNDS 5 /* with weights that fall gently, then */
#define HARD_ROUNDS 3 /* with outliers left out */
#define SOFT        2.5
#define SINGULAR    1e-6 /* of a column of the scaled Jacobian */
#define CONVERGED   1e-10

struct work {
    const struct fit *fit;
    double *weights; /* an observation */
    int m, n;
    double *fvec, *fjac, *diag, *qtf, *wa[3], *wa4;
    int *ipvt;
};

static int evaluate(void *data, int m, int n, const double *x, double *f, int flag) {
    const struct work *work = data;
    int dimension = work->fit->dimension;
    work->fit->residuals(x, f, work->fit->data);
    for (int i = 0; i < m; i++)
        f[i] *= work->weights[i / dimension];
    return 0;
}

static void solve(struct work *work, double *x) {
    int evaluations = 0;
    lmdif(evaluate, work, work->m, work->n, x, work->fvec, CONVERGED, CONVERGED, 0,
          60 * (work->n + 1), 0, work->diag, 1, 10, 0, &evaluations, work->fjac, work->m,
          work->ipvt, work->qtf, work->wa[0], work->wa[1], work->wa[2], work->wa4);
}

static double size_of(const struct fit *fit, const double *residuals, int i) {
    double sum = 0;
    for (int k = 0; k < fit->dimension; k++)
        sum += residuals[i * fit->dimension + k] * residuals[i * fit->dimension + k];
    return isfinite(sum) ? sqrt(sum) : FIT_LOST;
}

static int compare(gconstpointer a, gconstpointer b) {
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* What a residual usually is, by the median: half of a normal deviate's sizes lie within 0.6745 σ,
 * in two dimensions within 1.1774 σ. */
static double usual_size(const struct fit *fit, const double *residuals) {
    g_autofree double *sizes = g_new(double, fit->n_observations);
    for (int i = 0; i < fit->n_observations; i++)
        sizes[i] = size_of(fit, residuals, i);
    qsort(sizes, (gsize)fit->n_observations, sizeof *sizes, compare);
    return MAX(sizes[fit->n_observations / 2] / (fit->dimension == 1 ? 0.6745 : 1.1774), 1e-9);
}

static void weigh(const struct fit *fit, const double *residuals, gboolean hard, double *weights) {
    double usual = usual_size(fit, residuals);
    for (int i = 0; i < fit->n_observations; i++) {
        double times = size_of(fit, residuals, i) / usual;
        if (i >= fit->n_observations - fit->n_sure) {
            weights[i] = 1;
            continue;
        }
        weights[i] = hard ? times <= fit->reject : 1 / sqrt(1 + times * times / (SOFT * SOFT));
    }
}

/* (RᵀR)⁻¹ of the QR decomposition with pivots that the last step has left, rows of parameters that
 * are not determined 0. */
static void covariance(const struct work *work, double variance, struct fit_result *ret) {
    int n = work->n;
    g_autofree double *r = g_new0(double, n *n), *w = g_new(double, n);
    g_autofree int *pivots = g_memdup2(work->ipvt, sizeof(int) * (gsize)n);
    double most = 0;
    ret->undetermined = -1;
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            r[j * n + i] = work->fjac[j * work->m + i];
    for (int j = 0; j < n; j++) {
        double scale = work->diag[work->ipvt[j] - 1];
        most = MAX(most, scale > 0 ? fabs(r[j * n + j]) / scale : 0);
    }
    for (int j = n - 1; j >= 0; j--) {
        double scale = work->diag[work->ipvt[j] - 1];
        if (!(scale > 0) || !(fabs(r[j * n + j]) / scale > SINGULAR * most))
            ret->undetermined = work->ipvt[j] - 1;
    }
    covar(n, r, n, pivots, 1e-14, w);
    ret->covariance = g_new(double, n *n);
    for (int i = 0; i < n * n; i++)
        ret->covariance[i] = r[i] * variance;
}

static void finish(const struct work *work, const double *x, struct fit_result *ret) {
    const struct fit *fit = work->fit;
    ret->residuals = g_new(double, work->m);
    ret->rejected = g_new0(guint8, fit->n_observations);
    fit->residuals(x, ret->residuals, fit->data);
    double sum = 0;
    for (int i = 0; i < fit->n_observations; i++) {
        ret->rejected[i] = work->weights[i] == 0;
        if (ret->rejected[i])
            continue;
        double size = size_of(fit, ret->residuals, i);
        ret->n_used++;
        sum += size * size;
    }
    ret->degrees_of_freedom = ret->n_used * fit->dimension - work->n;
    double variance = ret->degrees_of_freedom > 0 ? sum / ret->degrees_of_freedom : 0;
    ret->sigma = sqrt(variance);
    covariance(work, variance, ret);
    if (ret->degrees_of_freedom <= 0 && ret->undetermined < 0)
        ret->undetermined = 0;
}

gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret) {
    int n = fit->n_parameters, m = fit->n_observations * fit->dimension;
    memset(ret, 0, sizeof *ret);
    if (m <= n)
        return FALSE;
    g_autofree double *weights = g_new(double, fit->n_observations);
    g_autofree double *now = g_new(double, m), *fvec = g_new(double, m), *wa4 = g_new(double, m);
    g_autofree double *small = g_new0(double, 5 * (gsize)n);
    g_autofree double *fjac = g_new0(double, (gsize)m *(gsize)n);
    g_autofree int *ipvt = g_new0(int, n);
    struct work work = {fit,   weights,   m,
                        n,     fvec,      fjac,
                        small, small + n, {small + 2 * n, small + 3 * n, small + 4 * n},
                        wa4,   ipvt};
    for (int round = 0; round < SOFT_ROUNDS + HARD_ROUNDS; round++) {
        fit->residuals(parameters, now, fit->data);
        for (int i = 0; round == 0 && i < m; i++)
            if (!isfinite(now[i]))
                return FALSE;
        weigh(fit, now, round >= SOFT_ROUNDS, weights);
        solve(&work, parameters);
    }
    finish(&work, parameters, ret);
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
