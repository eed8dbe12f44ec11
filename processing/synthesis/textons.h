/* Synthesis texel by texel (Tong et al. 2002). The texels of the sample are clustered into textons,
 * and the map is filled from coarse to fine. Each texel p of the map gets a texel s of the sample
 * whose neighbourhood has the textons that are already around p.
 *
 * The cost of s at p is Σ_d |c (t (p + d)) − c (t (s + d))|² over the 5 × 5 offsets d, where t is
 * the texton of a texel and c the centre of a texton. There are two kinds of candidates:
 * - texels s (p + d) − d, which continue a neighbour of p in the sample. s (p + d) is the texel of
 *   the sample that was chosen for the neighbour.
 * - texels whose neighbourhood is similar to that of a candidate of the first kind.
 * The result has the statistics of the sample, but not its long-range order. */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Fills level 0 of the map. The map and the features must have the same sample. The search for
 * similar texels uses the threads of work; the filling runs in one thread. The result depends only
 * on the seed and the features. Returns FALSE with an error when cancelled. The progress stage
 * "textons" occurs twice for each level: for the search for similar texels, and for the filling. */
gboolean textons_synthesize(const struct texel_features *features, guint32 seed,
                            const struct work *work, struct index_map *map, GError **error);
