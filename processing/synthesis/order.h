/* How ordered a material is, measured by the autocorrelation of its texels' features over lags,
 *   ρ (d) = Σ_p f (p) · f (p + d) / √(Σ_p |f (p)|² Σ_p |f (p + d)|²).
 * The sums are over all p for which p and p + d are in the sample. An ordered material has peaks of
 * ρ at its periods. If a synthesis destroys the order, the peaks are missing. */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Returns the period in texels, or 0 if there is none. Along each axis, the period is the lag of
 * the first peak of ρ that is at least 0.3 and at least 0.1 above the minimum before it. Lags from
 * 3 texels to half of the sample are considered. If both axes have a period, the larger one is
 * returned. */
int order_period(const struct texel_features *features);

/* Returns the RMS difference between ρ of the sample and ρ of a map. Lags are at most a third of
 * the sample's shorter side, and at most the shorter side of the map. 0 means that the order is
 * kept, 1 that it is lost completely. */
double order_difference(const struct texel_features *features, const struct index_map *map);

/* Compares neighbouring texels of a map that are not neighbours in the sample (seams) with
 * neighbours in the sample. The distances are RMS distances of features between each texel and the
 * texels to the right of it and below it. */
struct order_seams {
    /* pairs: number of pairs of neighbours in the map
     * seams: number of pairs that are not neighbours in the sample */
    int seams, pairs;
    double seam, inside; /* RMS distance over the seams, and over all neighbours in the sample */
};
struct order_seams order_seams(const struct texel_features *features, const struct index_map *map);
