/* Finds a grid of circles of any size among spots in a picture. Pure; any thread. */
#pragma once

#include <glib.h>

/* spots: double x, y, in the picture. Returns the spots of the whole rectangle of circles that they
 * form, row by row, as double x, y, and its size. staggered: every second row is moved by half the
 * distance of two circles; board.h says how columns and rows are counted. NULL: the spots that
 * neighbour each other form no rectangle, or one of less than 3 × 3 circles. */
GArray *spot_grid_find(const GArray *spots, gboolean staggered, int *ret_columns, int *ret_rows);
