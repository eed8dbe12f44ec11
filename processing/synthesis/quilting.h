/* Synthesis by image quilting (Efros and Freeman 2001). Square blocks of the sample are laid so
 * that they overlap. Each block is chosen to fit the blocks that it overlaps, and is cut along the
 * path where it differs least from them. The interior of a block is kept, and with it the order of
 * the sample. */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Returns the side of the blocks, in texels. It is 1.5 times the sample's period, or 3/8 of the
 * sample's shorter side if there is no period. It is limited to between a quarter and a half of the
 * shorter side. It is at least 8 texels, or the whole shorter side if that has less than 8. */
int quilting_block(const struct texel_features *features);

/* Fills level 0 of the map. The map and the features must have the same sample. block is the side
 * of the blocks in texels, for example the result of quilting_block(). The result depends only on
 * the seed, the features and block, not on the number of threads. Returns FALSE with an error when
 * cancelled. The progress stage is "quilting". */
gboolean quilting_synthesize(const struct texel_features *features, int block, guint32 seed,
                             const struct work *work, struct index_map *map, GError **error);
