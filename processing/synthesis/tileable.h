/* Makes a part of a sample that can be repeated. The right edge of the sample is laid over its left
 * edge, and its lower edge over its upper edge. Both overlaps are cut along the path of least error
 * (Efros and Freeman 2001); the second path is closed. Errors are distances of features
 * (texel_features.h), so that the same path is cut for all views and lights and the MDF. */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Makes the part, and chooses its period in each dimension. A period is at least half of the
 * sample. If the material itself has a period, the chosen period is a multiple of it.
 *
 * The function chooses the longest period whose cut is good enough. The mean difference of the two
 * pictures at the cut must be at most 1.1 times the minimum over all periods, plus a hundredth of
 * the mean square distance of neighbouring texels.
 *
 * The cost of a cut between two columns is its visible effect: the step between the two texels that
 * become neighbours, plus half of the difference of both overlapping pictures there (Kwatra et al.
 * 2003 eq. 1, squared). */
struct index_map *tileable_make(const struct texel_features *features);
