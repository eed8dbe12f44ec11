/* This module finds a grid of circles of any size among spots in a picture. The function is pure,
 * and any thread may call it. */
#pragma once

#include <glib.h>

/* spots are doubles x, y in the picture. Returns the spots of the full rectangle of circles that
 * they form, row by row, as doubles x, y, and the size of the rectangle. If staggered is TRUE,
 * every second row is shifted by half the distance of two circles; board.h says how columns and
 * rows are counted. Returns NULL if there are more than 1600 spots, if no more than half of them
 * are connected, or if the connected spots form no rectangle, or a rectangle with fewer than 3
 * rows, or fewer than 3 columns (2 if staggered). */
GArray *spot_grid_find(const GArray *spots, gboolean staggered, int *ret_columns, int *ret_rows);
