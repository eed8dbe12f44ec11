/* Weights and error bars of missing pairs; see prediction.h. */
#include "prediction.h"

#include <cblas.h>
#include <lapacke.h>
#include <string.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "prediction_private.h"

#define COVERED 0.95 /* share of the errors in cross-validation that must be within 2 σ */
#define FILL    16   /* number of texels that are predicted together */

/* The constants from which the fit to a material starts. They were chosen with the test material
 * weave (docs/lab/fast.md). */
static const double prediction_prior[PREDICTION_CONSTANTS] = {1,   0.5, 1,   2,   0.3, 0.4,
                                                              0.8, 0.3, 0.3, 2.0, 0.01};

void prediction_free(Prediction *prediction) {
    if (!prediction)
        return;
    g_free(prediction->views);
    g_free(prediction->lights);
    g_free(prediction->views_mm);
    g_free(prediction->lights_mm);
    g_free(prediction->squares);
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
    prediction->views_mm = g_memdup2(pairs->views_mm, sizeof(struct vec3) * (gsize)pairs->n_views);
    prediction->lights_mm =
        g_memdup2(pairs->lights_mm, sizeof(struct vec3) * (gsize)pairs->n_lights);
    prediction->squares = g_new(double, MAX(n, 1));
    prediction->groups = g_new(int, n);
    for (int p = 0; p < n; p++)
        prediction->groups[p] = pairs->groups ? pairs->groups[p] : p;
    for (int p = 0; p < n; p++)
        prediction->squares[p] = 1;
    prediction->measured = g_new(int, n);
    prediction->missing = g_new(int, n);
    memcpy(prediction->constants, prediction_prior, sizeof prediction_prior);
    prediction->excess_rms = prediction->excess_95 = 1;
    prediction->left_out_error = prediction->left_out_share = NAN;
    return prediction;
}

static void set_measured(Prediction *prediction, const float *probes, gsize n_rows) {
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

Prediction *prediction_begin(const struct prediction_pairs *pairs, const float *probes,
                             int n_probes) {
    Prediction *prediction = prediction_of(pairs);
    set_measured(prediction, probes, 3 * (gsize)n_probes);
    return prediction;
}

void prediction_directions(const Prediction *prediction, struct vec3 at_mm, int pair,
                           struct vec3 *ret_view, struct vec3 *ret_light) {
    const int v = pair / prediction->n_lights, l = pair % prediction->n_lights;
    *ret_view = prediction->views_mm ? vec3_unit(vec3_sub(prediction->views_mm[v], at_mm))
                                     : prediction->views[v];
    *ret_light = prediction->lights_mm ? vec3_unit(vec3_sub(prediction->lights_mm[l], at_mm))
                                       : prediction->lights[l];
}

void prediction_mean_of(const Prediction *prediction, struct vec3 view, struct vec3 light,
                        double ret[3]) {
    prediction_mean(prediction->mean, prediction->max_gloss, view, light, ret);
}

void prediction_means(const Prediction *prediction, struct vec3 at_mm, double *ret) {
    for (int p = 0; p < prediction->n_pairs; p++) {
        struct vec3 v, l;
        prediction_directions(prediction, at_mm, p, &v, &l);
        prediction_mean(prediction->mean, prediction->max_gloss, v, l, ret + 3 * (gsize)p);
    }
}

void prediction_rows_clear(struct prediction_rows *rows) {
    g_free(rows->z);
    g_free(rows->g);
    g_free(rows->probes);
}

gboolean prediction_rows_take(const Prediction *prediction, const float *probes,
                              const struct vec3 *at_mm, int n_probes, struct prediction_rows *ret,
                              GError **error) {
    const gsize m = (gsize)prediction->n_measured, most = 3 * (gsize)n_probes;
    g_autofree double *means = g_new(double, 3 * (gsize)prediction->n_pairs);
    *ret = (struct prediction_rows){0, g_new(double, most *m), g_new(double, most *m),
                                    g_new(int, most)};
    for (int row = 0; row < (int)most; row++) {
        const float *from = probes + (gsize)row * (gsize)prediction->n_pairs;
        double *z = ret->z + (gsize)ret->n * m, *g = ret->g + (gsize)ret->n * m;
        gboolean whole = TRUE;
        if (row % 3 == 0)
            prediction_means(prediction, at_mm[row / 3], means);
        for (gsize i = 0; i < m; i++) {
            const int pair = prediction->measured[i];
            g[i] = means[3 * pair + row % 3];
            z[i] = (double)from[pair] / g[i];
            whole = whole && isfinite(z[i]);
        }
        ret->probes[ret->n] = row;
        ret->n += whole;
    }
    if (ret->n == 0)
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "none of the %d sampled texels and colours has a finite value in each of the %d "
            "captured pairs of view and light; capture the pictures that lack values again",
            3 * n_probes, prediction->n_measured);
    return ret->n > 0;
}

static gboolean factorise(Prediction *prediction, GError **error) {
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
                "the covariance of %d measured pairs of directions cannot be inverted; check that "
                "the directions of views and lights are numbers",
                m);
    return FALSE;
}

/* Computes the weights k_uᵀ K⁻¹ and the variances of missing pairs. With B = L⁻¹ k, the weights are
 * Bᵀ L⁻¹ and the variances k_uu − |B_u|². */
static void weigh(Prediction *prediction) {
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

/* Computes s² = yᵀ K⁻¹ y / m of n rows of measured values y. rows (n × m) has the values, and
 * receives L⁻¹ y. */
static void prediction_scales(const Prediction *prediction, double *rows, int n, double *ret) {
    const int m = prediction->n_measured;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, m, n, 1,
                prediction->factor, m, rows, m);
    for (int r = 0; r < n; r++) {
        const double *row = rows + (gsize)r * (gsize)m;
        ret[r] = cblas_ddot(m, row, 1, row, 1) / m;
    }
}

/* Sets excess_rms, excess_95, left_out_error and left_out_share from the errors of
 * cross-validation. scales has s² of each row. */
static void validate(Prediction *prediction, const struct prediction_rows *rows,
                     const double *scales) {
    const gsize m = (gsize)prediction->n_measured, n = (gsize)rows->n, all = n * m;
    g_autofree double *inverse = g_memdup2(prediction->factor, sizeof(double) * m * m);
    g_autofree double *errors = g_new(double, all), *variances = g_new(double, m);
    LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', (int)m, inverse, (int)m);
    for (gsize i = 0; i < m; i++)
        for (gsize j = 0; j < i; j++)
            inverse[i * m + j] = inverse[j * m + i];
    prediction_left_out(prediction, prediction->measured, (int)m, inverse, rows->z, (int)n, errors,
                        variances);
    double squares = 0, expected = 0, energy = 0;
    for (gsize r = 0; r < n; r++)
        for (gsize i = 0; i < m; i++) {
            const gsize k = r * m + i;
            const double g2 = rows->g[k] * rows->g[k], e2 = errors[k] * errors[k];
            const double variance = scales[r] * variances[i];
            squares += g2 * e2;
            expected += g2 * variance;
            energy += g2 * rows->z[k] * rows->z[k];
            errors[k] = variance > 0 ? e2 / variance : 0;
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

/* Sets squares to the mean over rows of g² s², for each pair. Sets energy to the mean over rows of
 * Σ ρ², the sum over all pairs, measured and predicted. */
static void sum_up(Prediction *prediction, const struct prediction_rows *rows,
                   const struct vec3 *at_mm, const double *scales) {
    const int m = prediction->n_measured, u = prediction->n_missing;
    g_autofree double *means = g_new(double, 3 * (gsize)prediction->n_pairs);
    g_autofree float *known = g_new(float, m), *filled = g_new(float, MAX(u, 1));
    memset(prediction->squares, 0, sizeof(double) * (gsize)prediction->n_pairs);
    prediction->energy = 0;
    for (int r = 0; r < rows->n; r++) {
        const double *z = rows->z + (gsize)r * (gsize)m, *g = rows->g + (gsize)r * (gsize)m;
        const int colour = rows->probes[r] % 3;
        double sum = 0;
        if (r == 0 || rows->probes[r] / 3 != rows->probes[r - 1] / 3)
            prediction_means(prediction, at_mm[rows->probes[r] / 3], means);
        for (int i = 0; i < m; i++) {
            known[i] = (float)z[i];
            sum += z[i] * z[i] * g[i] * g[i];
        }
        if (u > 0)
            cblas_sgemv(CblasRowMajor, CblasNoTrans, u, m, 1, prediction->weights, m, known, 1, 0,
                        filled, 1);
        for (int k = 0; k < u; k++) {
            const double value =
                (double)filled[k] * means[3 * (gsize)prediction->missing[k] + (gsize)colour];
            sum += value * value;
        }
        for (gsize p = 0; p < (gsize)prediction->n_pairs; p++) {
            const double mean = means[3 * p + (gsize)colour];
            prediction->squares[p] += mean * mean * scales[r] / rows->n;
        }
        prediction->energy += sum / rows->n;
    }
}

static gboolean learn_rows(Prediction *prediction, const struct prediction_rows *rows,
                           const struct vec3 *at_mm, const struct work *work, GError **error) {
    if (!prediction_fit(prediction, rows->z, rows->g, rows->n, work, error) ||
        !factorise(prediction, error))
        return FALSE;
    weigh(prediction);
    const gsize n = (gsize)rows->n, m = (gsize)prediction->n_measured;
    g_autofree double *solved = g_memdup2(rows->z, sizeof(double) * n * m);
    g_autofree double *scales = g_new(double, n);
    prediction_scales(prediction, solved, (int)n, scales);
    validate(prediction, rows, scales);
    sum_up(prediction, rows, at_mm, scales);
    return TRUE;
}

gboolean prediction_uses(int k, int n) {
    const gint64 most = MIN(n, PREDICTION_MAX_MEASURED);
    return (k + 1) * most / n > k * most / n;
}

static gboolean learn(Prediction *prediction, const float *probes, const struct vec3 *at_mm,
                      int n_probes, const struct work *work, GError **error) {
    if (prediction->n_measured > PREDICTION_MAX_MEASURED) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%d pairs of view and light are captured, but the prediction of the others can use "
            "at most %d; plan fewer views or lights, or capture all pairs, so that none is "
            "predicted",
            prediction->n_measured, PREDICTION_MAX_MEASURED);
        return FALSE;
    }
    g_autofree struct vec3 *middle = at_mm ? NULL : g_new0(struct vec3, n_probes);
    struct prediction_rows rows;
    at_mm = at_mm ? at_mm : middle;
    prediction_mean_fit(prediction, probes, at_mm, n_probes, NULL, PREDICTION_MEAN_EVALUATIONS);
    const gboolean ok = prediction_rows_take(prediction, probes, at_mm, n_probes, &rows, error) &&
                        learn_rows(prediction, &rows, at_mm, work, error);
    prediction_rows_clear(&rows);
    return ok;
}

Prediction *prediction_new(const struct prediction_pairs *pairs, const float *probes,
                           const struct vec3 *at_mm, int n_probes, const struct work *work,
                           GError **error) {
    g_autoptr(Prediction) prediction = prediction_begin(pairs, probes, n_probes);
    /* With several threads, the sums of OpenBLAS would depend on the number of threads. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    const gboolean ok =
        prediction->n_measured == 0 || learn(prediction, probes, at_mm, n_probes, work, error);
    openblas_set_num_threads(threads);
    if (prediction->n_measured == 0)
        prediction->energy = prediction->n_pairs * (prediction_prior_variance(prediction, 0) -
                                                    prediction->constants[PREDICTION_NUGGET]);
    return ok ? g_steal_pointer(&prediction) : NULL;
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

/* Predicts n rows: those of R, G and B of at most FILL texels. means has g of all pairs of these
 * texels. */
static void fill_rows(const Prediction *prediction, float *values, const double *means, int n,
                      float *ret_sigma) {
    const int m = prediction->n_measured, u = prediction->n_missing;
    const gsize all = (gsize)prediction->n_pairs;
    g_autofree float *known = g_new(float, (gsize)n *(gsize)m);
    g_autofree float *filled = g_new(float, MAX((gsize)n * (gsize)u, 1));
    g_autofree double *z = g_new(double, (gsize)n *(gsize)m), *scales = g_new(double, n);
    for (gsize r = 0; r < (gsize)n; r++)
        for (gsize i = 0; i < (gsize)m; i++) {
            const gsize pair = (gsize)prediction->measured[i];
            z[r * (gsize)m + i] =
                (double)values[r * all + pair] / means[(r / 3 * all + pair) * 3 + r % 3];
            known[r * (gsize)m + i] = (float)z[r * (gsize)m + i];
        }
    if (u > 0)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, u, m, 1, known, m,
                    prediction->weights, m, 0, filled, u);
    if (ret_sigma)
        prediction_scales(prediction, z, n, scales);
    for (gsize r = 0; r < (gsize)n; r++)
        for (gsize k = 0; k < (gsize)u; k++) {
            const gsize pair = (gsize)prediction->missing[k];
            const double g = means[(r / 3 * all + pair) * 3 + r % 3];
            const double value = g * (double)filled[r * (gsize)u + k];
            values[r * all + pair] = (float)(value < 0 ? 0 : value);
            if (ret_sigma)
                ret_sigma[r * all + pair] =
                    (float)(g * sqrt(prediction->excess_95 * scales[r] * prediction->variance[k]));
        }
}

void prediction_fill(const Prediction *prediction, float *values, const struct vec3 *at_mm, int n,
                     float *ret_sigma) {
    const gsize all = (gsize)prediction->n_pairs;
    g_autofree double *means = g_new(double, 3 * (gsize)FILL * all);
    if (ret_sigma)
        memset(ret_sigma, 0, sizeof(float) * 3 * (gsize)n * all);
    for (int t = 0; prediction->n_measured > 0 && t < n; t += FILL) {
        const int texels = MIN(FILL, n - t);
        for (int i = 0; i < texels; i++)
            prediction_means(prediction, at_mm ? at_mm[t + i] : vec3(0, 0, 0),
                             means + 3 * (gsize)i * all);
        fill_rows(prediction, values + 3 * (gsize)t * all, means, 3 * texels,
                  ret_sigma ? ret_sigma + 3 * (gsize)t * all : NULL);
    }
}

double prediction_relative_error(const Prediction *prediction, double variances) {
    return PREDICTION_CHOSEN *
           sqrt(prediction->excess_rms * fmax(variances, 0) / prediction->energy);
}

double prediction_error(const Prediction *prediction) {
    double sum = 0;
    if (prediction->n_measured == 0)
        return 1;
    for (int u = 0; u < prediction->n_missing; u++)
        sum += prediction->squares[prediction->missing[u]] * prediction->variance[u];
    return prediction_relative_error(prediction, sum);
}

double prediction_left_out_error(const Prediction *prediction) {
    return prediction->left_out_error;
}

double prediction_left_out_share(const Prediction *prediction) {
    return prediction->left_out_share;
}
