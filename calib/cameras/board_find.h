/* Finds a board in a picture: without prior knowledge, or near a place. Any thread. */
#pragma once

#include "corner.h"

/* Finds the board's markers (or the whole chessboard, or all circles), then each of its corners.
 * fine (for photographs that calibrate a lens only): searches again from the positions found, which
 * yields some more, and accepts a ChArUco board whose first square has the other colour. GArray of
 * struct corner, by id. NULL: BOARD_ERROR_SPEC with a reason that is to follow "picture: ", such as
 * "no board is visible". */
GArray *board_find(const struct picture *picture, const struct board *board, gboolean fine,
                   GError **error);

/* Projects a point of the board to the picture; straight: for a lens without distortion, from
 * which the curvature follows that the lens gives to edges. FALSE: the point is not visible. */
typedef gboolean (*BoardProject)(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                                 gconstpointer data);

/* Shifts the whole board in the picture by up to reach_px to the largest correlation with its
 * print, then fits each corner. ret_fit: that correlation, −1 … 1. NULL: nothing there looks like
 * the board. */
GArray *board_find_near(const struct picture *picture, const struct board *board,
                        BoardProject project, gconstpointer data, double reach_px, double *ret_fit);

/* Adds the equations of the corners that are wanted (one number per id), which lie where the
 * geometry says, to within a fraction of a pixel. Returns how many it has added. */
int board_lateral(const struct picture *picture, const struct board *board, BoardProject project,
                  gconstpointer data, const guint8 *wanted, struct corner_lateral *lateral);
