/* Weights and error bars of missing pairs: see prediction.h. */
#include "prediction.h"

#include <cblas.h>
#include <lapacke.h>
#include <string.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "prediction_private.h"

#define COVERED 0.95 /* of values left out lie within 2 σ */
#define FILL    64   /* rows that are predicted at once */

/* What no particular material has: chosen on the weave. */
static const double prediction_prior[PREDICTION_CONSTANTS] = {1,   0.5, 1,   2,   0.3, 0.4,
                                                              0.8, 0.3, 0.3, 2.0, 0.01};

void prediction_free(Prediction *prediction) {
    if (!prediction)
        return;
    g_free(prediction->views);
    g_free(prediction->lights);
    g_free(prediction->groups);
    g_free(prediction->measured);
    g_free(prediction->missing);
    g_free(prediction->factor);
    g_free(prediction->weights);
    g_free(prediction->variance);
    g_free(prediction);
}

static Prediction *prediction_of(const struct prediction_pairs *pairs) {
    Prediction *prediction = g_new0(Prediction, 1);
    const int n = pairs->n_views * pairs->n_lights;
    prediction->n_views = pairs->n_views;
    prediction->n_lights = pairs->n_lights;
    prediction->n_pairs = n;
    prediction->views = g_memdup2(pairs->views, sizeof(struct vec3) * (gsize)pairs->n_views);
    prediction->lights = g_memdup2(pairs->lights, sizeof(struct vec3) * (gsize)pairs->n_lights);
    prediction->groups = g_new(int, n);
    for (int p = 0; p < n; p++)
        prediction->groups[p] = pairs->groups ? pairs->groups[p] : p;
    prediction->measured = g_new(int, n);
    prediction->missing = g_new(int, n);
    memcpy(prediction->constants, prediction_prior, sizeof prediction_prior);
    prediction->scale = prediction->excess_rms = prediction->excess_95 = 1;
    prediction->left_out_error = prediction->left_out_share = NAN;
    return prediction;
}

static void prediction_set_measured(Prediction *prediction, const float *probes, gsize n_rows) {
    const gsize n = (gsize)prediction->n_pairs;
    g_autofree gsize *counts = g_new0(gsize, n);
    for (gsize r = 0; r < n_rows; r++)
        for (gsize p = 0; p < n; p++)
            counts[p] += isfinite(probes[r * n + p]) != 0;
    for (gsize p = 0; p < n; p++)
        if (counts[p] > 0 && 2 * counts[p] >= n_rows)
            prediction->measured[prediction->n_measured++] = (int)p;
        else
            prediction->missing[prediction->n_missing++] = (int)p;
}

/* Values of measured pairs in rows that have all of them. */
static double *prediction_rows(const Prediction *prediction, const float *probes, int n_rows,
                               int *ret_n) {
    const gsize m = (gsize)prediction->n_measured;
    double *rows = g_new(double, MAX((gsize)n_rows * m, 1));
    *ret_n = 0;
    for (int r = 0; r < n_rows; r++) {
        const float *from = probes + (gsize)r * (gsize)prediction->n_pairs;
        double *to = rows + (gsize)*ret_n * m;
        gboolean whole = TRUE;
        for (gsize i = 0; i < m; i++) {
            to[i] = (double)from[prediction->measured[i]];
            whole = whole && isfinite(to[i]);
        }
        *ret_n += whole;
    }
    return rows;
}

static gboolean prediction_factorise(Prediction *prediction, GError **error) {
    const int m = prediction->n_measured;
    prediction->factor = g_new(double, (gsize)m *(gsize)m);
    prediction_covariance(prediction, prediction->measured, m, prediction->measured, m,
                          prediction->factor);
    for (int i = 0; i < m; i++)
        prediction->factor[(gsize)i * (gsize)m + (gsize)i] +=
            prediction->constants[PREDICTION_NUGGET];
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', m, prediction->factor, m) == 0)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "the covariance of %d measured pairs of directions cannot be inverted: are "
                "directions of views or lights not numbers?",
                m);
    return FALSE;
}

/* k_uᵀ K⁻¹ and the variances: with B = L⁻¹ k, they are Bᵀ L⁻¹ and k_uu − |B_u|². */
static void prediction_weigh(Prediction *prediction) {
    const int m = prediction->n_measured, n = prediction->n_missing;
    g_autofree double *b = g_new(double, MAX((gsize)m * (gsize)n, 1));
    prediction->variance = g_new(double, MAX(n, 1));
    prediction->weights = g_new(float, MAX((gsize)m * (gsize)n, 1));
    if (n == 0)
        return;
    prediction_covariance(prediction, prediction->measured, m, prediction->missing, n, b);
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, m, n, 1,
                prediction->factor, m, b, m);
    for (int u = 0; u < n; u++) {
        const double *column = b + (gsize)u * (gsize)m;
        const double known = cblas_ddot(m, column, 1, column, 1);
        prediction->variance[u] =
            fmax(prediction_prior_variance(prediction, prediction->missing[u]) - known, 1e-12);
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasTrans, CblasNonUnit, m, n, 1,
                prediction->factor, m, b, m);
    for (gsize i = 0; i < (gsize)m * (gsize)n; i++)
        prediction->weights[i] = (float)b[i];
}

/* s² of n rows of measured values: yᵀ K⁻¹ y / m. rows (n × m) become L⁻¹ y. */
static void prediction_scales(const Prediction *prediction, double *rows, int n, double *ret) {
    const int m = prediction->n_measured;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, m, n, 1,
                prediction->factor, m, rows, m);
    for (int r = 0; r < n; r++) {
        const double *row = rows + (gsize)r * (gsize)m;
        ret[r] = cblas_ddot(m, row, 1, row, 1) / m;
    }
}

/* Squares of errors of cross-validation in units of their variances, and what they tell. */
static void prediction_validate(Prediction *prediction, const double *rows, int n) {
    const gsize m = (gsize)prediction->n_measured, all = (gsize)n * m;
    g_autofree double *inverse = g_memdup2(prediction->factor, sizeof(double) * m * m);
    g_autofree double *errors = g_new(double, all), *variances = g_new(double, m);
    g_autofree double *solved = g_memdup2(rows, sizeof(double) * all), *scales = g_new(double, n);
    LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', (int)m, inverse, (int)m);
    for (gsize i = 0; i < m; i++)
        for (gsize j = 0; j < i; j++)
            inverse[i * m + j] = inverse[j * m + i];
    prediction_left_out(prediction, prediction->measured, (int)m, inverse, rows, n, errors,
                        variances);
    prediction_scales(prediction, solved, n, scales);
    double squares = 0, expected = 0, energy = 0;
    prediction->scale = 0;
    for (gsize r = 0; r < (gsize)n; r++) {
        prediction->scale += scales[r] / n;
        for (gsize i = 0; i < m; i++) {
            const double e = errors[r * m + i], variance = scales[r] * variances[i];
            squares += e * e;
            expected += variance;
            energy += rows[r * m + i] * rows[r * m + i];
            errors[r * m + i] = variance > 0 ? e * e / variance : 0;
        }
    }
    prediction->excess_rms = expected > 0 ? squares / expected : 1;
    prediction->left_out_error = energy > 0 ? sqrt(squares / energy) : 0;
    qsort(errors, all, sizeof *errors, robust_by_value);
    prediction->excess_95 = fmax(errors[(gsize)((double)(all - 1) * COVERED)] / 4, 1e-12);
    gsize within = 0;
    while (within < all && errors[within] <= 4 * prediction->excess_95)
        within++;
    prediction->left_out_share = (double)within / (double)all;
}

/* Mean over rows of Σ ρ² of measured and of predicted pairs. */
static double prediction_energy(const Prediction *prediction, const double *rows, int n) {
    const int m = prediction->n_measured, u = prediction->n_missing;
    g_autofree float *known = g_new(float, (gsize)n *(gsize)m);
    g_autofree float *filled = g_new(float, MAX((gsize)n * (gsize)u, 1));
    double sum = 0;
    for (gsize i = 0; i < (gsize)n * (gsize)m; i++) {
        known[i] = (float)rows[i];
        sum += rows[i] * rows[i];
    }
    if (u > 0)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, u, m, 1, known, m,
                    prediction->weights, m, 0, filled, u);
    for (gsize i = 0; i < (gsize)n * (gsize)u; i++)
        sum += (double)filled[i] * (double)filled[i];
    return sum / n;
}

static gboolean prediction_learn(Prediction *prediction, const float *probes, int n_rows,
                                 const struct work *work, GError **error) {
    int n;
    g_autofree double *rows = prediction_rows(prediction, probes, n_rows, &n);
    if (prediction->n_measured > PREDICTION_MOST_MEASURED) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%d pairs of directions are measured; prediction works with %d at most",
                    prediction->n_measured, PREDICTION_MOST_MEASURED);
        return FALSE;
    }
    if (n == 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "none of %d rows of probes has a value for each of %d measured pairs of "
                    "directions",
                    n_rows, prediction->n_measured);
        return FALSE;
    }
    if (!prediction_fit(prediction, rows, n, work, error) ||
        !prediction_factorise(prediction, error))
        return FALSE;
    prediction_weigh(prediction);
    prediction_validate(prediction, rows, n);
    prediction->energy = prediction_energy(prediction, rows, n);
    return TRUE;
}

Prediction *prediction_new(const struct prediction_pairs *pairs, const float *probes, int n_probes,
                           const struct work *work, GError **error) {
    g_autoptr(Prediction) prediction = prediction_of(pairs);
    prediction_set_measured(prediction, probes, 3 * (gsize)n_probes);
    /* Sums of several threads of OpenBLAS depend on their number. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    const gboolean ok = prediction->n_measured == 0 ||
                        prediction_learn(prediction, probes, 3 * n_probes, work, error);
    openblas_set_num_threads(threads);
    if (prediction->n_measured == 0)
        prediction->energy = prediction->n_pairs * (prediction_prior_variance(prediction, 0) -
                                                    prediction->constants[PREDICTION_NUGGET]);
    return ok ? g_steal_pointer(&prediction) : NULL;
}

int prediction_n_measured(const Prediction *prediction) {
    return prediction->n_measured;
}

const int *prediction_measured(const Prediction *prediction) {
    return prediction->measured;
}

gboolean prediction_is_measured(const Prediction *prediction, int pair) {
    int low = 0, high = prediction->n_measured;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (prediction->measured[middle] < pair)
            low = middle + 1;
        else
            high = middle;
    }
    return low < prediction->n_measured && prediction->measured[low] == pair;
}

/* At most FILL rows. */
static void prediction_fill_rows(const Prediction *prediction, float *values, int n,
                                 float *ret_sigma) {
    const int m = prediction->n_measured, u = prediction->n_missing;
    const gsize all = (gsize)prediction->n_pairs;
    g_autofree float *known = g_new(float, (gsize)n *(gsize)m);
    g_autofree float *filled = g_new(float, MAX((gsize)n * (gsize)u, 1));
    g_autofree double *rows = g_new(double, (gsize)n *(gsize)m), *scales = g_new(double, n);
    for (gsize r = 0; r < (gsize)n; r++)
        for (gsize i = 0; i < (gsize)m; i++)
            rows[r * (gsize)m + i] = (double)(known[r * (gsize)m + i] =
                                                  values[r * all + (gsize)prediction->measured[i]]);
    if (u > 0)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, u, m, 1, known, m,
                    prediction->weights, m, 0, filled, u);
    for (gsize r = 0; r < (gsize)n; r++)
        for (gsize k = 0; k < (gsize)u; k++) {
            const float value = filled[r * (gsize)u + k];
            values[r * all + (gsize)prediction->missing[k]] = value < 0 ? 0 : value;
        }
    if (!ret_sigma)
        return;
    memset(ret_sigma, 0, sizeof(float) * (gsize)n * all);
    prediction_scales(prediction, rows, n, scales);
    for (gsize r = 0; r < (gsize)n; r++)
        for (gsize k = 0; k < (gsize)u; k++)
            ret_sigma[r * all + (gsize)prediction->missing[k]] =
                (float)sqrt(prediction->excess_95 * scales[r] * prediction->variance[k]);
}

void prediction_fill(const Prediction *prediction, float *values, int n, float *ret_sigma) {
    const gsize all = (gsize)prediction->n_pairs;
    for (int r = 0; prediction->n_measured > 0 && r < n; r += FILL)
        prediction_fill_rows(prediction, values + (gsize)r * all, MIN(FILL, n - r),
                             ret_sigma ? ret_sigma + (gsize)r * all : NULL);
}

double prediction_error(const Prediction *prediction) {
    double sum = 0;
    if (prediction->n_measured == 0)
        return 1;
    for (int u = 0; u < prediction->n_missing; u++)
        sum += prediction->variance[u];
    return sqrt(prediction->excess_rms * prediction->scale * sum / prediction->energy);
}

double prediction_left_out_error(const Prediction *prediction) {
    return prediction->left_out_error;
}

double prediction_left_out_share(const Prediction *prediction) {
    return prediction->left_out_share;
}
