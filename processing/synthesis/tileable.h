/*
 * A part of a sample that can be repeated: its right edge is laid over its left one, and its lower
 * edge over its upper one, and both overlaps are cut along the path of least error (Efros and
 * Freeman 2001; the second path is closed). Errors are distances of features (texel_features.h), so
 * that one path is cut for all views and lights together with the MDF.
 */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/*
 * The period is chosen as well, from half of the sample on each way: the longest one at whose cut
 * both pictures differ by at most 1.1 times the least, or a hundredth of neighbours' mean square
 * distance more. A material that has a period gets a multiple of it.
 *
 * The cost of a cut between two columns is what a viewer sees of it: the jump between the two
 * texels that become neighbours, plus half of by how much both overlapping pictures differ there
 * (Kwatra et al. 2003 eq. 1, squared).
 */
struct index_map *tileable_make(const struct texel_features *features);
