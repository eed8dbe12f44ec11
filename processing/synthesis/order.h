/*
 * How ordered a material is: the autocorrelation of its texels' features over lags,
 *   ρ (d) = Σ_p f (p) · f (p + d) / √(Σ_p |f (p)|² Σ_p |f (p + d)|²),
 * the sums over all p for which p and p + d are in the sample. An ordered material has peaks of ρ
 * at its periods; a synthesis that destroys the order lacks them.
 */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* The period in texels: along each axis the first peak of ρ, at least 0.3 and 0.1 above what lies
 * before it, at a lag of up to half of the sample; of both the longer one. 0: there is none. */
int order_period(const struct texel_features *features);

/* The RMS difference between ρ of the sample and of a map, over lags of up to a third of the
 * sample's shorter side. 0: the order is kept; 1: all of it is lost. */
double order_difference(const struct texel_features *features, const struct index_map *map);

/* How much texels of a map that are not neighbours in the sample differ, compared with neighbours:
 * RMS distances of features between each texel and those to its right and below it. */
struct order_seams {
    int seams, pairs;    /* pairs of neighbours in the map, and those that are none in the sample */
    double seam, inside; /* RMS distances, of these and of all neighbours in the sample */
};
struct order_seams order_seams(const struct texel_features *features, const struct index_map *map);
