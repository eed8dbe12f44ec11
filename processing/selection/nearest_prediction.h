/* Predicts the missing pairs of a BTF while it is captured. The model is that of prediction.h, but
 * each missing pair is predicted only from the NEAREST_NEIGHBOURS measured pairs that have the
 * largest covariance with it (kriging with a moving neighbourhood: Cressie 1993, §3.2.4). The time
 * therefore grows with the number of pairs, and not with its third power.
 *
 * Let S be the neighbours of a missing pair u. The weights of the ratios z_S are w_u = K_SS⁻¹ k_Su.
 * The variance of ρ_u is e g_u² s² (k_uu − k_Suᵀ w_u), where s² is the mean of z² over the measured
 * pairs of the row.
 *
 * g_u is limited to the maximum of g at the measured pairs, because the directions that are not
 * measured yet may be far from all measured ones. For the same reason the diffuse part of g changes
 * only with cos θ_l below the lowest measured light, and not at all below the lowest measured view.
 * Where the highlights of g exceed their limit, the square b_u of the excess is added to the
 * variance, because it is unknown how bright these highlights are.
 *
 * The factor e comes from a cross-validation at the distances of the missing pairs. For each
 * missing pair u, the measured pair t that is nearest to u is predicted. It is predicted from the
 * measured pairs i that are at least as far from t as u is (k_ti ≤ k_tu), and that were not taken
 * by the same shot as t. e is the sum of the squared errors, divided by the sum of the variances.
 *
 * The expected error is right only if the measured pairs are spread over all directions. If a whole
 * range of directions is missing, such as all low lights, the measured pairs do not show what is
 * special there, for instance long shadows.
 *
 * Objects are constant after nearest_prediction_new(): any thread. */
#pragma once

#include "prediction.h"

#define NEAREST_NEIGHBOURS 48

typedef struct NearestPrediction NearestPrediction;

/* Fits the model to probes, which are as in prediction_new(). If `like` is not NULL, the mean
 * material and the constants of the covariance are taken from `like`, which must be for the same
 * directions. This takes a fraction of the time of a fit. The error is DATA_ERROR_INVALID if no row
 * of probes has a value for each measured pair. Can be cancelled by work. */
NearestPrediction *nearest_prediction_new(const struct prediction_pairs *pairs, const float *probes,
                                          const struct vec3 *at_mm, int n_probes,
                                          const NearestPrediction *like, const struct work *work,
                                          GError **error);
void nearest_prediction_free(NearestPrediction *prediction); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(NearestPrediction, nearest_prediction_free)

/* Gives the measured pairs from which a missing pair is predicted (*ret_pairs), and their weights
 * w_i (*ret_weights): z = Σ w_i z_i. Both arrays belong to the prediction. Returns the number of
 * pairs, at most NEAREST_NEIGHBOURS. Returns 0 for a measured pair, and for all pairs if nothing is
 * measured. */
int nearest_prediction_weights(const NearestPrediction *prediction, int pair, const int **ret_pairs,
                               const float **ret_weights);

/* Computes g of R, G and B for a pair, at a position on the sample. */
void nearest_prediction_mean(const NearestPrediction *prediction, struct vec3 at_mm, int pair,
                             double ret[3]);

/* Returns the expected relative error √(Σ σ² / Σ ρ²) over all pairs and probes. Measured pairs
 * contribute no variance. Returns 1 if nothing is measured. */
double nearest_prediction_error(const NearestPrediction *prediction);

/* Gives the range in which the true error is expected with a probability of 90 %. The range is wide
 * if most of the error is in few pairs, such as those of a sharp highlight. */
void nearest_prediction_error_range(const NearestPrediction *prediction, double ret[2]);

/* Returns the expected error of one pair, relative to its own values: √(Σ σ² / Σ ρ²) over probes.
 * Returns 0 for a measured pair, and 1 if nothing is measured. */
double nearest_prediction_pair_error(const NearestPrediction *prediction, int pair);

/* Returns the error that is expected (nearest_prediction_error()) after further pairs are measured:
 * those for which `more` (n_pairs) is TRUE. At most `targets` of the pairs that would still be
 * missing are examined, evenly spread. Returns 1 if nothing is measured yet, and 0 if no pair would
 * be missing. */
double nearest_prediction_error_after(const NearestPrediction *prediction, const gboolean *more,
                                      int targets);
