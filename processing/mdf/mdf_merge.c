#include "mdf_merge.h"

#include <glib.h>
#include <math.h>

#define MOST 256 /* maximum number of candidates */

/* Returns Σ over sweeps of the maximum over the sweep's candidates i of weight_i · exp(−½ ((mm_i −
 * mm) / tolerance_i)²). */
static double support_of(const struct mdf_candidate *candidates, int n, double mm) {
    double sum = 0, best = 0;
    for (int i = 0; i < n; i++) {
        if (i > 0 && candidates[i].sweep != candidates[i - 1].sweep) {
            sum += best;
            best = 0;
        }
        double off = (candidates[i].mm - mm) / candidates[i].tolerance_mm;
        best = MAX(best, candidates[i].weight * exp(-0.5 * off * off));
    }
    return sum + best;
}

struct deviation {
    float mm;
    double weight;
};

/* Returns the weighted median of the samples. If the middle falls between two samples, this is
 * their mean. Sorts the samples by distance, by insertion because there are few of them. */
static double weighted_median(struct deviation *samples, int n) {
    double total = 0, sum = 0;
    for (int i = 1; i < n; i++) {
        const struct deviation sample = samples[i];
        int k = i;
        for (; k > 0 && samples[k - 1].mm > sample.mm; k--)
            samples[k] = samples[k - 1];
        samples[k] = sample;
    }
    for (int i = 0; i < n; i++)
        total += samples[i].weight;
    for (int i = 0; i < n; i++) {
        sum += samples[i].weight;
        if (sum > 0.5 * total * (1 + 1e-12))
            return samples[i].mm;
        if (sum >= 0.5 * total * (1 - 1e-12) && i + 1 < n)
            return 0.5 * ((double)samples[i].mm + (double)samples[i + 1].mm);
    }
    return samples[n - 1].mm;
}

/* Computes the mean of a bend over the samples that have it, and the variance of the mean from the
 * scatter of these samples. If no sample has the bend, the mean is NAN. */
static void bend_of(const struct mdf_candidate *samples, int n, int bend, double *ret_mm,
                    double *ret_noise_mm2) {
    double weights = 0, sum = 0, scatter = 0;
    int known = 0;
    for (int i = 0; i < n; i++) {
        if (!isfinite(samples[i].bend_mm[bend]))
            continue;
        weights += samples[i].weight;
        sum += samples[i].weight * samples[i].bend_mm[bend];
        known++;
    }
    *ret_mm = weights > 0 ? sum / weights : NAN;
    for (int i = 0; i < n && known > 1; i++) {
        const double share = samples[i].weight / weights;
        if (isfinite(samples[i].bend_mm[bend]))
            scatter += pow(share * (samples[i].bend_mm[bend] - *ret_mm), 2) / MAX(1 - share, 1e-6);
    }
    *ret_noise_mm2 = scatter;
}

/* Computes the spread of n agreeing samples, with the formulas of mdf_errors.h. mean is their
 * weighted mean. */
static void spread_of(const struct mdf_candidate *samples, int n, double mean,
                      struct mdf_spread *ret) {
    double weights = 0, scatter = 0, expected = 0, sum = 0, squares = 0;
    *ret = (struct mdf_spread){.n = n};
    for (int i = 0; i < n; i++)
        weights += samples[i].weight;
    for (int i = 0; i < n; i++)
        ret->unit_mm2 += pow(samples[i].weight / weights * samples[i].frame_mm, 2);
    for (int i = 0; i < n; i++)
        ret->hidden += samples[i].weight / weights * MAX(1 - (double)samples[i].shown, 0);
    for (int i = 0; i < n && n > 1; i++) {
        const double share = samples[i].weight / weights;
        const double factor = share * share / MAX(1 - share, 1e-6);
        const double frame_mm2 = pow((double)samples[i].frame_mm, 2);
        scatter += factor * pow(samples[i].mm - mean, 2);
        expected += factor * (frame_mm2 * (1 - 2 * share) + ret->unit_mm2);
        sum += factor * frame_mm2;
        squares += pow(factor * frame_mm2, 2);
    }
    if (expected > 0) {
        ret->frames2 = scatter / expected;
        ret->freedom = MAX(sum * sum / squares - 1, 1);
    }
    for (int k = 0; k < MDF_BENDS; k++)
        bend_of(samples, n, k, &ret->bend_mm[k], &ret->noise_mm2[k]);
}

struct mdf_merged mdf_merge_mean(const struct mdf_candidate *samples, int n) {
    struct mdf_merged merged = {.mm = -1};
    double weights = 0, sum = 0;
    for (int i = 0; i < n; i++) {
        weights += samples[i].weight;
        sum += samples[i].weight * samples[i].mm;
    }
    if (!(weights > 0))
        return merged;
    merged.mm = (float)(sum / weights);
    merged.n = n;
    spread_of(samples, n, sum / weights, &merged.spread);
    return merged;
}

struct mdf_merged mdf_merge(struct mdf_candidate *candidates, int n, int least) {
    const struct mdf_merged nothing = {.mm = -1};
    struct deviation deviations[MOST] = {{0}};
    double most = -1, mode = 0; /* mode is the distance of the candidate with the largest support */
    int one_each = 0, kept = 0;
    g_return_val_if_fail(n <= MOST, nothing);
    if (n == 0)
        return nothing;
    for (int i = 0; i < n; i++) {
        double support = support_of(candidates, n, candidates[i].mm);
        if (support > most) {
            most = support;
            mode = candidates[i].mm;
        }
    }
    /* Only that candidate of each sweep is kept that is closest to the mode. */
    for (int i = 0; i < n; i++) {
        if (one_each == 0 || candidates[i].sweep != candidates[one_each - 1].sweep)
            candidates[one_each++] = candidates[i];
        else if (fabs(candidates[i].mm - mode) < fabs(candidates[one_each - 1].mm - mode))
            candidates[one_each - 1] = candidates[i];
    }
    /* spread is a robust standard deviation: 1.4826 × weighted median of |mm_i − mode|. */
    for (int i = 0; i < one_each; i++)
        deviations[i] =
            (struct deviation){(float)fabs(candidates[i].mm - mode), candidates[i].weight};
    double spread = 1.4826 * weighted_median(deviations, one_each);
    for (int i = 0; i < one_each; i++)
        if (fabs(candidates[i].mm - mode) <= MAX(3 * spread, candidates[i].tolerance_mm))
            candidates[kept++] = candidates[i];
    return kept < least ? nothing : mdf_merge_mean(candidates, kept);
}
