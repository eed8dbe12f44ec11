/* This module finds a grid of circles of any size among spots in a picture. The function is pure,
 * and any thread may call it. */
#pragma once

#include <glib.h>

/* spots are doubles x, y in the picture. Returns the spots of the full rectangle of circles that
 * they form, row by row, as doubles x, y, and the size of the rectangle. If staggered is TRUE,
 * every second row is shifted by half the distance of two circles; board.h says how columns and
 * rows are counted. Returns NULL if there are more than 1600 spots, if no more than half of the
 * spots are connected, or if the connected spots form no rectangle. The rectangle must have at
 * least 3 rows and 3 columns, or 2 columns if staggered. */
GArray *spot_grid_find(const GArray *spots, gboolean staggered, int *ret_columns, int *ret_rows);
