/* This module finds a grid of circles of any size among spots in a picture. The function is pure,
 * and any thread may call it. */
#pragma once

#include <glib.h>

/* `spots` has doubles x, y: the places of spots in the picture. Returns the spots that form a full
 * rectangle of circles, row by row, as doubles x, y. *ret_columns and *ret_rows get the size of the
 * rectangle. If staggered is TRUE, every second row is shifted by half the distance of two circles;
 * board.h says how columns and rows are counted.
 *
 * Returns NULL if there are more than 1600 spots, if no more than half of the spots are connected,
 * or if the connected spots form no rectangle. The rectangle must have at least 3 rows and 3
 * columns, or 2 columns if staggered. */
GArray *spot_grid_find(const GArray *spots, gboolean staggered, int *ret_columns, int *ret_rows);
