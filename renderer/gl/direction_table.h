/*
 * Interpolation weights of measured directions on the graphics card: for any direction of the
 * hemisphere up to four measured ones and their weights, as directions.h finds them. Schneider 2004
 * §4 uses cube maps; here the hemisphere is one square, so that no sample lies below the horizon.
 * Read by directions.glsl.
 */
#pragma once

#include "direction_textures.h"
#include "directions/directions.h"

/* fade: the weights fall to 0 at the horizon, as reflectance under a light does; see
 * directions_fade(). The index of the pole is that of the directions' number, see
 * directions_pole(). */
struct direction_textures direction_table_new(Directions *directions, gboolean fade);

/* ret_shares: the weight of each of n directions in the mean that stands for the pole; all 0 if the
 * pole was measured or the set is triangulated. */
void direction_table_pole_shares(const Directions *directions, float *ret_shares, int n);
