/*
 * The three measured directions nearest to any other and their weights, as two cube maps (Schneider
 * 2004 §5): the corners of a triangle of the measured ones, and its barycentric coordinates. Not
 * filtered, because beyond an edge of a triangle the next texel names other directions; the angular
 * resolution is a third of a degree. Directions below the horizon are clamped to it.
 */
#pragma once

#include "direction_textures.h"
#include "directions/directions.h"

/* directions: triangulated. fade: as direction_table_new(). Indices are held as 1/65535. */
struct direction_textures direction_cube_new(Directions *directions, gboolean fade);
