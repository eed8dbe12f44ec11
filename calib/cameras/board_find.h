/*
 * A board in a picture: looked for without knowing anything, or where it should be. Any thread.
 */
#pragma once

#include "corner.h"

/* Looks for the board's markers (or the whole chessboard), then for each of its corners; fine:
 * again from where these are, which finds some more. GArray of struct corner, by id. NULL:
 * BOARD_ERROR_SPEC with a reason that begins after "picture: ", such as "no board is to be seen".
 */
GArray *board_find(const struct picture *picture, const struct board *board, gboolean fine,
                   GError **error);

/* Where the board should be: FALSE for points that cannot be seen. */
typedef gboolean (*BoardProject)(const double xy_mm[2], double ret_xy_px[2], gpointer data);

/* straight: the same as project for a lens that bends nothing; edges are then fitted as curved as
 * the lens makes them. NULL: not known.
 *
 * Shifts the whole board in the picture by up to reach_px until what is printed on it fits best to
 * what is seen, then looks for each corner. ret_fit: the correlation reached, −1 … 1. NULL: nothing
 * there looks like the board. */
GArray *board_find_near(const struct picture *picture, const struct board *board,
                        BoardProject project, BoardProject straight, gpointer data, double reach_px,
                        double *ret_fit);
