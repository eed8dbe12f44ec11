/*
 * The three measured directions around any direction, and their weights, as two cube maps
 * (Schneider 2004 §5). The three directions are the corners of a triangle of the measured
 * directions, and the weights are the barycentric coordinates in this triangle. The angular
 * resolution is a third of a degree. A direction below the horizon has the values of the horizon at
 * its azimuth. The maps are not filtered, because neighbouring texels name different directions if
 * an edge of a triangle lies between them.
 */
#pragma once

#include "direction_textures.h"
#include "directions/directions.h"

/* Makes the cube maps. directions must come from directions_new_triangulated(). For fade, see
 * direction_table_new(). Indices are stored in units of 1/65535. */
struct direction_textures direction_cube_new(Directions *directions, gboolean fade);
