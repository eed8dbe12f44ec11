/*
 * Interpolation weights of measured directions on the graphics card. For any direction of the
 * hemisphere, the table has up to four measured directions and their weights, as directions.h
 * computes them. Schneider 2004 §4 uses cube maps. Here the hemisphere is one square
 * (directions.h), so that no sample of the table lies below the horizon. directions.glsl reads the
 * table.
 */
#pragma once

#include "direction_textures.h"
#include "directions/directions.h"

/* Makes the table. If fade is TRUE, the weights decrease to 0 at the horizon, like reflectance when
 * the light approaches the horizon; see directions_fade(). In the table, the index of the pole is
 * the number of directions; see directions_pole(). */
struct direction_textures direction_table_new(Directions *directions, gboolean fade);

/* ret_shares receives the weights of the n directions in the mean that stands for the pole. All
 * weights are 0 if the pole was measured or the set is triangulated. */
void direction_table_pole_shares(const Directions *directions, float *ret_shares, int n);
