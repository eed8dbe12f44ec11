/* The struct and the functions that nearest_prediction.c, prediction.c, prediction_choose.c,
 * prediction_kernel.c and prediction_mean.c share. */
#pragma once

#include "base/robust.h"
#include "prediction.h"

/* Constants of the covariance: the c_i, a_i, b_i and ε of prediction.h, ε being the nugget. */
enum {
    PREDICTION_C1,
    PREDICTION_C2,
    PREDICTION_A2,
    PREDICTION_B2,
    PREDICTION_C3,
    PREDICTION_A3,
    PREDICTION_B3,
    PREDICTION_C4,
    PREDICTION_A4,
    PREDICTION_B4,
    PREDICTION_NUGGET,
    PREDICTION_CONSTANTS
};

#define PREDICTION_LOBES 2
#define PREDICTION_MEAN  (5 + 9 * PREDICTION_LOBES)

struct prediction {
    int n_views, n_lights, n_pairs;
    struct vec3 *views, *lights;
    struct vec3 *views_mm, *lights_mm; /* NULL if cameras and lamps are far away */
    int *groups;                       /* n_pairs */
    double mean[PREDICTION_MEAN];      /* parameters of g (prediction_mean.c) */
    /* maximum of the lobes of g at measured pairs; the lobes are limited to this value
     * everywhere */
    double max_gloss;
    /* constants of the covariance, in the order of the enum above */
    double constants[PREDICTION_CONSTANTS];
    int n_measured, n_missing;
    int *measured, *missing; /* pairs, ascending */
    /* The next three are NULL if nothing is measured. */
    double *factor;   /* n_measured²: Cholesky factor L of K, lower, columns one after another */
    float *weights;   /* n_missing × n_measured */
    double *variance; /* n_missing: k_uu − k_uᵀ K⁻¹ k_u, without s² */
    double *squares;  /* n_pairs: mean of g² s² over the rows of probes */
    double energy;    /* Σ ρ² over all pairs of a row; mean over the rows of probes */
    /* Factors on variances, from cross-validation. excess_rms is the sum of the squared errors
     * divided by the sum of the variances. If variances are multiplied by excess_95, 95 % of the
     * errors are within 2 σ. */
    double excess_rms;
    double excess_95;
    /* See prediction_left_out_error() and prediction_left_out_share(). NaN if nothing is
     * measured. */
    double left_out_error, left_out_share;
};

/* Makes a prediction with default constants, and sets which pairs are measured (prediction_new()).
 * Free it with prediction_free(). */
Prediction *prediction_begin(const struct prediction_pairs *pairs, const float *probes,
                             int n_probes);

/* The rows of probes that have all measured pairs. */
struct prediction_rows {
    int n;
    double *z, *g; /* n × n_measured: ratios ρ / g, and g */
    /* for each of the n rows, its number among the rows of the probes: 3 × probe + colour */
    int *probes;
};

/* Takes the rows from probes as in prediction_new(). Fails with DATA_ERROR_INVALID if no row has
 * all measured pairs. Call prediction_rows_clear() even if this fails. */
gboolean prediction_rows_take(const Prediction *prediction, const float *probes,
                              const struct vec3 *at_mm, int n_probes, struct prediction_rows *ret,
                              GError **error);
void prediction_rows_clear(struct prediction_rows *rows);

/* Gives the directions of a pair at a position on the sample. */
void prediction_directions(const Prediction *prediction, struct vec3 at_mm, int pair,
                           struct vec3 *ret_view, struct vec3 *ret_light);

/* Computes g of all pairs at a position on the sample: n_pairs × 3. */
void prediction_means(const Prediction *prediction, struct vec3 at_mm, double *ret);

/* Return the two parts of g: that of a diffuser, and the sum of the lobes. */
void prediction_mean_diffuse(const double *parameters, double cos_v, double cos_l, double ret[3]);
double prediction_mean_gloss(const double *parameters, struct vec3 v, struct vec3 l);
/* minimum of ρ and of g; darker values count as this value */
#define PREDICTION_MIN_MEAN 1e-4
/* Evaluates g of R, G, B, with the sum of its lobes limited to max_gloss. */
void prediction_mean(const double *parameters, double max_gloss, struct vec3 v, struct vec3 l,
                     double ret[3]);
/* Fits the parameters of g and max_gloss to probes as in prediction_new(). `like` has parameters
 * from which the fit starts. If `like` is NULL or has no lobes, the fit is started several times,
 * with different widths of lobes. `most` is the maximum number of evaluations of the residuals for
 * each start. If there are too few values for a fit, g becomes the diffuser cos θ_l without
 * lobes. */
#define PREDICTION_MEAN_EVALUATIONS (200 * (PREDICTION_MEAN + 1))
void prediction_mean_fit(Prediction *prediction, const float *probes, const struct vec3 *at_mm,
                         int n_probes, const double *like, int most);

/* Factor on expected errors. It is needed because shots are chosen by the variances that the
 * covariance predicts, so that the variances of the remaining shots are too small. On the eight
 * materials of docs/lab/fast.md, with a quarter of the shots, the errors were 1.1 … 1.6 times as
 * large as predicted. */
#define PREDICTION_CHOSEN 1.5

/* Returns the expected relative error PREDICTION_CHOSEN · √(excess_rms · variances / Σ ρ²), where
 * variances is the sum of the variances of ρ over missing pairs. */
double prediction_relative_error(const Prediction *prediction, double variances);

/* Computes k(p, p') without ε, for p = a[i] and p' = b[j]: ret[i + n_a · j]. */
void prediction_covariance(const Prediction *prediction, const int *a, int n_a, const int *b,
                           int n_b, double *ret);
/* Computes k(p, p') with ε, for all p and p' of n pairs: ret is n × n. Uses no threads, because it
 * is meant for few pairs. */
void prediction_covariance_small(const Prediction *prediction, const int *pairs, int n,
                                 double *ret);
double prediction_prior_variance(const Prediction *prediction, int pair); /* k(p, p), with ε */

/* Fits the constants to rows (n_rows × n_measured) of ratios z of measured pairs. Errors are
 * weighted by g (of the same shape). Returns FALSE with an error when cancelled. The progress stage
 * is "prediction". */
gboolean prediction_fit(Prediction *prediction, const double *rows, const double *g, int n_rows,
                        const struct work *work, GError **error);

/* Computes the errors of m pairs in cross-validation: the pairs of each group B are left out
 * together. rows (n_rows × m) has the values y. A group of more than 64 pairs is divided into parts
 * of at most 64, which are left out separately.
 *
 * inverse is K⁻¹ (m × m, symmetric). The errors are e_B = y_B − ŷ_B = (K⁻¹_BB)⁻¹ (K⁻¹ y)_B, and
 * their variances without s² are the diagonal of (K⁻¹_BB)⁻¹ (Rasmussen and Williams 2006, §5.4.2,
 * extended to groups of more than one pair). ret_errors is n_rows × m, and ret_variances has m
 * values. */
void prediction_left_out(const Prediction *prediction, const int *pairs, int m,
                         const double *inverse, const double *rows, int n_rows, double *ret_errors,
                         double *ret_variances);
