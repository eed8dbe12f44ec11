/* Synthesis by image quilting (Efros and Freeman 2001). Square blocks of the sample are laid over
 * each other. Each block is chosen so that it fits the blocks that it overlaps, and is cut along
 * the path where both differ least. The interior of a block is kept, and with it the order of the
 * sample. */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* Returns the side of the blocks, in texels: 1.5 times the sample's period if it has one, otherwise
 * 3/8 of its shorter side. The side is limited to between a quarter and a half of the shorter side,
 * but is at least 8 texels if the sample has so many. */
int quilting_block(const struct texel_features *features);

/* Fills level 0 of the map. The map and the features must have the same sample. block is the result
 * of quilting_block(), or another side. The result depends only on the seed and the features, not
 * on the number of threads. Returns FALSE with an error when cancelled. The progress stage is
 * "quilting". */
gboolean quilting_synthesize(const struct texel_features *features, int block, guint32 seed,
                             const struct work *work, struct index_map *map, GError **error);
