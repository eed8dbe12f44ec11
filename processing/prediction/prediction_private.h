/* Shared by the files of prediction.h. */
#pragma once

#include "base/robust.h"
#include "prediction.h"

/* Constants of the covariance (prediction.h): c₁; c₂ a₂ b₂; c₃ a₃ b₃; c₄ a₄ b₄; ε. */
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
    struct vec3 *views_mm, *lights_mm; /* NULL: far away */
    int *groups;                       /* n_pairs */
    double mean[PREDICTION_MEAN];      /* parameters of g (prediction_mean.c) */
    double most_gloss; /* of g, at pairs that were measured: a lobe between them cannot be more */
    double constants[PREDICTION_CONSTANTS]; /* of the covariance */
    int n_measured, n_missing;
    int *measured, *missing; /* pairs, ascending */
    double *factor;    /* n_measured²: Cholesky factor L of K, lower, columns one after another */
    float *weights;    /* n_missing × n_measured; NULL where nothing is measured */
    double *variance;  /* n_missing: k_uu − k_uᵀ K⁻¹ k_u, without s² */
    double *squares;   /* n_pairs: mean of g² s² over the rows of probes */
    double energy;     /* Σ ρ² over all pairs, mean over the rows of probes */
    double excess_rms; /* squared errors of cross-validation over their variances: mean, */
    double excess_95;  /* and what makes 95 % of them lie within 2 σ */
    double left_out_error, left_out_share;
};

/* Directions of a pair at a place of the sample. */
void prediction_directions(const Prediction *prediction, struct vec3 at_mm, int pair,
                           struct vec3 *ret_view, struct vec3 *ret_light);

/* g of R, G, B, its lobes together at most most_gloss; and its parameters and most_gloss, fitted to
 * probes as in prediction_new(). */
void prediction_mean(const double *parameters, double most_gloss, struct vec3 v, struct vec3 l,
                     double ret[3]);
void prediction_mean_fit(Prediction *prediction, const float *probes, const struct vec3 *at_mm,
                         int n_probes);

/* Shots are chosen by the variances that this covariance gives, so that these are too low at those
 * that are left: the errors were 1.1 … 1.6 times as large with a quarter of the shots on the eight
 * materials of docs/fast.md. */
#define PREDICTION_CHOSEN 1.5

/* The expected relative error for a sum of variances over missing pairs. */
double prediction_relative_error(const Prediction *prediction, double variances);

/* k(p, p') without ε of pairs a[i], b[j]: ret[i + n_a · j]. */
void prediction_covariance(const Prediction *prediction, const int *a, int n_a, const int *b,
                           int n_b, double *ret);
/* The same with ε of a few pairs among themselves, without threads: n². */
void prediction_covariance_small(const Prediction *prediction, const int *pairs, int n,
                                 double *ret);
double prediction_prior_variance(const Prediction *prediction, int pair); /* with ε */

/* Fits the constants to rows (n_rows × n_measured) of ratios z of measured pairs; errors count by g
 * (of the same shape). FALSE when cancelled. */
gboolean prediction_fit(Prediction *prediction, const double *rows, const double *g, int n_rows,
                        const struct work *work, GError **error);

/* Errors e = y_B − ŷ_B of rows (n_rows × m) when the pairs of each group B are left out together,
 * and their variances without s²: e_B = (K⁻¹_BB)⁻¹ (K⁻¹ y)_B, with variances the diagonal of
 * (K⁻¹_BB)⁻¹ (Rasmussen and Williams 2006, §5.4.2, for more than one). inverse: K⁻¹, m × m,
 * symmetric; ret_errors: n_rows × m; ret_variances: m. */
void prediction_left_out(const Prediction *prediction, const int *pairs, int m,
                         const double *inverse, const double *rows, int n_rows, double *ret_errors,
                         double *ret_variances);
