/*
 * Synthesis texel by texel (Tong et al. 2002): the texels of the sample are clustered into textons,
 * and the picture grows, from coarse to fine, by texels whose neighbourhood in the sample has the
 * textons that stand around the place already.
 *
 * The cost of texel s of the sample at place p is Σ_d |c (t (p + d)) − c (t (s + d))|² over the 5 ×
 * 5 places d around, with t the texton of a texel and c its centre. Candidates are those that
 * continue a neighbour of p (the texel s (p + d) − d), and texels with a neighbourhood like theirs.
 * This follows the statistics of the sample, but not an order of long range.
 */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Fills level 0 of the map, whose sample is that of the features. Runs in one thread; the result
 * depends on the seed and the features only. FALSE when cancelled. */
gboolean textons_synthesize(const struct texel_features *features, guint32 seed,
                            const struct work *work, struct index_map *map, GError **error);
