/* A BTF of which only a part of the pairs (view, light) was captured. The other pairs are predicted
 * from those that were captured, with an error bar, and the pairs to capture next are chosen.
 *
 * A mean material g is fitted first, with the reflection of a diffuser and of two anisotropic
 * lobes:
 *
 *   g = d_c cos θ_l exp (e_v (1 − cos θ_v) + e_l (1 − cos θ_l))
 *     + Σ s (1 + |A (h_xy / h_z − m)|² / γ)^−γ / (cos^p θ_v cos^q θ_l)
 *
 * d_c is the reflectance of the diffuser for the colour c. The sum is over the lobes. h is the half
 * vector of v and l. The shape of a lobe is that of Trowbridge and Reitz 1975 for γ = 2, and that
 * of Ward 1992 for γ → ∞. All other letters are parameters of the fit. The lobes are limited to
 * their maximum at the measured pairs, so that no lobe appears where nothing was measured.
 *
 * g uses the exact directions of each texel. Near a camera or a lamp these differ by several
 * degrees over a sample, which changes a highlight considerably.
 *
 * The ratios z = ρ / g of one texel and colour (a row) over pairs p = (v, l) are modelled as a
 * Gaussian process of mean 0. Its covariance k(p, p') is the same for all texels of a material,
 * except for a factor s² of each texel (Rasmussen and Williams 2006, §2.2; kriging: Cressie 1993,
 * §3.2). v and l are nominal unit vectors, and h is the unit half vector of v and l (Rusinkiewicz
 * 1998). With d_v = |v − v'|, and d_l and d_h defined in the same way:
 *
 *   k = 1 + c₁ l·l'                                          albedo; a normal that is tilted
 *     + c₂ exp (−d_v / a₂ − d_l / b₂)                        the visible part of the relief
 *     + c₃ exp (−d_v / a₃ − d_l / b₃)                        shadows
 *     + c₄ exp (−d_h / a₄ − d_v / b₄)                        highlights
 *     + ε δ_pp'                                              independent of neighbouring pairs
 *
 * The constants are fitted to the material by cross-validation: all pairs that were taken together
 * are left out together and predicted, and the squared error is minimised. (A shot shows the same
 * light to all cameras.) A factor from the same cross-validation is chosen so that 95 % of the
 * left-out values are within 2 σ.
 *
 * With K the covariance of the measured pairs, the weights of a missing pair u are k_uᵀ K⁻¹, the
 * same for all texels and colours. The variance of ρ is g² s² (k_uu − k_uᵀ K⁻¹ k_u), where s² = yᵀ
 * K⁻¹ y / m for the m measured ratios y of the row.
 *
 * Results depend only on the arguments, not on threads. Objects are constant after
 * prediction_new(): any thread. */
#pragma once

#include "base/vec.h"
#include "base/work.h"

/* The pairs of view and light of a BTF. Directions are unit vectors in the sample frame, at the
 * sample's centre. The pair (v, l) has the index v · n_lights + l. */
struct prediction_pairs {
    int n_views, n_lights;
    const struct vec3 *views, *lights;
    /* positions of camera and lamp; NULL if cameras and lamps are far away */
    const struct vec3 *views_mm, *lights_mm;
    /* n_views · n_lights: pairs with the same number are taken together, by one shot. NULL if each
     * pair is taken by a separate shot. */
    const int *groups;
};

typedef struct prediction Prediction;

/* Maximum number of measured pairs; with more, the error is DATA_ERROR_INVALID. K takes 8 bytes ×
 * the square of this number. */
#define PREDICTION_MAX_MEASURED 6000
/* Returns whether the k-th of n measured pairs, counted from 0, is in the evenly spread part of at
 * most PREDICTION_MAX_MEASURED pairs. If n may be larger, give prediction_new() only this part. */
gboolean prediction_uses(int k, int n);

/* Fits the model. probes has n_probes × 3 × n_pairs values ρ of R, G, B at some texels, NaN if not
 * measured. Some hundred texels are enough. at_mm (n_probes) has the positions of the texels in the
 * sample frame; NULL if all are in its centre. All arrays are copied. Can be cancelled by work. The
 * progress stage is "prediction".
 *
 * A pair is measured if at least half of the rows have it. Rows that lack a value of a measured
 * pair are left out. If nothing is measured, the constants are defaults, and s² = 1.
 *
 * The error is DATA_ERROR_INVALID if no row is left, if more than PREDICTION_MAX_MEASURED pairs are
 * measured, or if K cannot be inverted. */
Prediction *prediction_new(const struct prediction_pairs *pairs, const float *probes,
                           const struct vec3 *at_mm, int n_probes, const struct work *work,
                           GError **error);
void prediction_free(Prediction *prediction); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Prediction, prediction_free)

gboolean prediction_is_measured(const Prediction *prediction, int pair);

/* Predicts the missing pairs of n texels, at positions as in prediction_new(). values is n × 3 ×
 * n_pairs and must be finite at measured pairs; the missing pairs are set to values ≥ 0. ret_sigma
 * (n × 3 × n_pairs) receives σ, which is 0 for measured pairs; it may be NULL. A row with a value
 * that is not finite at a measured pair gets NaN at all missing pairs. If nothing is measured,
 * values are not changed. Any thread. */
void prediction_fill(const Prediction *prediction, float *values, const struct vec3 *at_mm, int n,
                     float *ret_sigma);

/* Returns the expected relative error, 1.5 √(Σ σ² / Σ ρ²) over all pairs and probes. Measured pairs
 * contribute no variance. The factor 1.5 is needed because the shots were chosen by their variance.
 * Returns 1 if nothing is measured. */
double prediction_error(const Prediction *prediction);

/* prediction_left_out_error() returns the relative error of cross-validation, √(Σ (predicted −
 * measured)² / Σ measured²) over measured pairs. prediction_left_out_share() returns the share of
 * their values whose error is within 2 σ. Both return NAN if nothing is measured. */
double prediction_left_out_error(const Prediction *prediction);
double prediction_left_out_share(const Prediction *prediction);

/* Computes how each of n lights of one view is predicted from the other lights. The lights may be
 * in any directions. view and lights are unit vectors. Returns FALSE if K cannot be inverted. Any
 * thread.
 *
 * The ratio of light j is predicted as z_j = Σ_i w_ij z_i from the ratios z_i = ρ_i / g_i of the
 * others, with w_ij = −(K⁻¹)_ij / (K⁻¹)_jj and w_jj = 0 (Rasmussen and Williams 2006 eq. 5.12). K
 * is the covariance of the n lights, with the constants of the model. ret_weights[i + n · j]
 * receives w_ij. */
gboolean prediction_left_out_weights(const Prediction *prediction, struct vec3 view,
                                     const struct vec3 *lights, int n, double *ret_weights);
/* Computes g of R, G, B for a view and a light. */
void prediction_mean_of(const Prediction *prediction, struct vec3 view, struct vec3 light,
                        double ret[3]);

/* A shot that may be captured, with the pairs that it would measure and its price. */
struct prediction_shot {
    const int *pairs;
    int n_pairs;
    double price_s; /* time that the shot takes, above 0 */
};
struct prediction_choice {
    int shot; /* index of the chosen shot */
    /* expected errors without and with the shot, as prediction_error() returns them */
    double error_before, error_after;
};

/* Chooses up to `most` shots, one at a time. Each time, it chooses the shot that reduces the summed
 * variance of all pairs most for its price, given all pairs that are measured or were chosen before
 * (the criterion A of optimal design; Krause et al. 2008). taken (n_shots) marks shots that cannot
 * be chosen; it may be NULL. ret has space for `most` choices. The progress stage is "choice".
 *
 * Returns the number of chosen shots. This number is smaller than `most` if no more shots are left,
 * or if no other shot reduces the variance. Returns −1 with an error when cancelled.
 *
 * To save time, the sums are over at most PREDICTION_TARGETS pairs, which are spread over all. If
 * more than PREDICTION_CANDIDATES shots are left, only this number of them, evenly spread, is
 * considered. */
#define PREDICTION_TARGETS    900
#define PREDICTION_CANDIDATES 1200
int prediction_choose(const Prediction *prediction, const struct prediction_shot *shots,
                      int n_shots, const gboolean *taken, int most, struct prediction_choice *ret,
                      const struct work *work, GError **error);
