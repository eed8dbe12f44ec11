/*
 * A BTF of which only a part of the pairs (view, light) was captured: the others are predicted from
 * those that were, with an error bar, and what to capture next is chosen.
 *
 * A mean material g is fitted first: what a diffuser and two anisotropic lobes reflect,
 *
 *   g = d_c cos θ_l exp (e_v (1 − cos θ_v) + e_l (1 − cos θ_l))
 *     + Σ s (1 + |A (h_xy / h_z − m)|² / γ)^−γ / (cos^p θ_v cos^q θ_l)
 *
 * with the half vector h of v and l (γ = 2: the shape of Trowbridge and Reitz 1975, γ → ∞ that of
 * Ward 1992). It takes the exact directions of each texel, which differ by some degrees over a
 * sample beside a camera or a lamp; a highlight changes a lot by that.
 *
 * The lobes count at most as much as at any measured pair, so that none stands where nothing was
 * measured.
 *
 * The ratio z = ρ / g of a texel and colour over pairs p = (v, l) is taken as a Gaussian process of
 * mean 0, whose covariance k(p, p') is the same for all texels of a material up to a factor s² of
 * each (Rasmussen and Williams 2006, §2.2; kriging: Cressie 1993, §3.2). With v, l nominal unit
 * vectors, h the unit half vector of v and l (Rusinkiewicz 1998), and d_v = |v − v'|, d_l, d_h
 * alike:
 *
 *   k = 1 + c₁ l·l'                                          albedo; a normal that is tilted
 *     + c₂ exp (−d_v / a₂ − d_l / b₂)                        what a view shows of the relief
 *     + c₃ exp (−d_v / a₃ − d_l / b₃)                        shadows
 *     + c₄ exp (−d_h / a₄ − d_v / b₄)                        highlights
 *     + ε δ_pp'                                              what neighbours say nothing of
 *
 * The constants are fitted to the material: those of the least squared error with which measured
 * pairs are predicted when all pairs that were taken at once are left out together (a shot shows
 * the same light to all cameras). With K the covariance of the measured pairs, the weights of a
 * missing pair u are k_uᵀ K⁻¹, the same for all texels and colours, and the variance of ρ is
 * g² s² (k_uu − k_uᵀ K⁻¹ k_u), where s² = yᵀ K⁻¹ y / m for the m measured ratios y of the row. A
 * factor from the same cross-validation makes 95 % of the left-out values lie within 2 σ.
 *
 * Results depend on the arguments alone, not on threads. Objects are constant after
 * prediction_new(): any thread.
 */
#pragma once

#include "base/vec.h"
#include "base/work.h"

/* Directions are units in the sample frame, of the sample's centre. Pair (v, l) has the index v ·
 * n_lights + l. */
struct prediction_pairs {
    int n_views, n_lights;
    const struct vec3 *views, *lights;
    const struct vec3 *views_mm, *lights_mm; /* where camera and lamp stand; NULL: far away */
    const int *groups; /* n_views · n_lights: pairs of the same number are taken at once; NULL:
                          each pair by itself */
};

typedef struct prediction Prediction;

/* More measured pairs than these are not worked with (DATA_ERROR_INVALID): K takes 8 bytes ×
 * their square. */
#define PREDICTION_MOST_MEASURED 6000

/* probes: n_probes × 3 × n_pairs values ρ of R, G, B at some texels, NaN: not measured. at_mm:
 * n_probes, where the texels lie in the sample frame; NULL: all in its middle. A pair is
 * measured if at least half of the rows have it; rows that lack a value of a measured pair are left
 * out. Nothing measured, or no rows: the constants are those of no particular material, and s² = 1.
 * Some hundred texels are enough. Everything is copied. Cancelled by work. Progress stage
 * "prediction". */
Prediction *prediction_new(const struct prediction_pairs *pairs, const float *probes,
                           const struct vec3 *at_mm, int n_probes, const struct work *work,
                           GError **error);
void prediction_free(Prediction *prediction); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Prediction, prediction_free)

int prediction_n_measured(const Prediction *prediction);
gboolean prediction_is_measured(const Prediction *prediction, int pair);

/* Predicts the missing pairs of n texels, as prediction_new() has them. values: n × 3 × n_pairs,
 * measured pairs finite; those missing are set (≥ 0). ret_sigma: n × 3 × n_pairs, 0 for measured
 * pairs; may be NULL. A row with a value that is not finite at a measured pair gets NaN in all
 * missing ones. Any thread. */
void prediction_fill(const Prediction *prediction, float *values, const struct vec3 *at_mm, int n,
                     float *ret_sigma);

/* The expected relative error, 1.5 √(Σ σ² / Σ ρ²) over all pairs and probes, measured ones adding
 * nothing: the factor is for shots that were chosen by their variance. 1 if nothing is measured. */
double prediction_error(const Prediction *prediction);

/* The same of cross-validation: √(Σ (predicted − measured)² / Σ measured²), over measured pairs;
 * and the share of their values within 2 σ. NAN if nothing is measured. */
double prediction_left_out_error(const Prediction *prediction);
double prediction_left_out_share(const Prediction *prediction);

/* What may be captured: the pairs of a shot, and its price. */
struct prediction_shot {
    const int *pairs;
    int n_pairs;
    double price_s; /* > 0 */
};
struct prediction_choice {
    int shot;
    double error_before, error_after; /* as prediction_error() */
};

/* Chooses up to most shots, one at a time: the one whose pairs, given all measured ones and those
 * chosen before, lower the summed variance of all pairs most for its price (the criterion A of
 * optimal design; Krause et al. 2008). taken: n_shots, those that cannot be chosen; may be NULL.
 * ret: room for most. Returns how many are chosen: fewer if no others are left. Sums run over at
 * most PREDICTION_TARGETS pairs, spread over all, and if more than PREDICTION_CANDIDATES shots are
 * left, some of them, evenly spread, are looked at. −1 with error when cancelled. */
#define PREDICTION_TARGETS    900
#define PREDICTION_CANDIDATES 1200
int prediction_choose(const Prediction *prediction, const struct prediction_shot *shots,
                      int n_shots, const gboolean *taken, int most, struct prediction_choice *ret,
                      const struct work *work, GError **error);

/* The set that every material begins with: the first n that prediction_choose() takes when nothing
 * is measured. Nested: fewer are the first of more. Returns how many; −1 as above. */
int prediction_start(const struct prediction_pairs *pairs, const struct prediction_shot *shots,
                     int n_shots, int n, int *ret, const struct work *work, GError **error);
