/*
 * Synthesis by image quilting (Efros and Freeman 2001): square blocks of the sample are laid over
 * each other, each chosen so that it fits what it overlaps, and cut along the path where both
 * differ least. What a block holds is kept, and with it the order of the sample.
 */
#pragma once

#include "index_map.h"
#include "texel_features.h"

/* The side of the blocks, in texels: half as long again as the sample's period where it has one,
 * else 3/8 of its shorter side, within a quarter and a half of that. */
int quilting_block(const struct texel_features *features);

/* Fills level 0 of the map, whose sample is that of the features. block: as quilting_block() gives
 * it, or another. The result depends on the seed and the features only, not on the number of
 * threads. FALSE when cancelled. */
gboolean quilting_synthesize(const struct texel_features *features, int block, guint32 seed,
                             const struct work *work, struct index_map *map, GError **error);
