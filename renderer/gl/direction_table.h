/*
 * A set of measured directions on the card: for any direction of the hemisphere up to four of them
 * and their weights, as directions.h finds them. Where Schneider 2004 §4 has cube maps, the
 * hemisphere is one square, so that no sample lies below the horizon. Read by directions.glsl.
 */
#pragma once

#include "direction_textures.h"
#include "directions.h"

/* fade: the weights fall to 0 at the horizon, as reflectance under a light does; see
 * directions_fade(). The index of the pole is that of the directions' number, see
 * directions_pole(). */
struct direction_textures direction_table_new(Directions *directions, gboolean fade);

/* shares: of each of n directions in the mean that is the pole; 0 without a pole. */
void direction_table_pole_shares(const Directions *directions, float *ret_shares, int n);
