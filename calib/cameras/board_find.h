/* This module finds a board in a picture, either without prior knowledge or near a predicted place.
 * Any thread may call the functions. */
#pragma once

#include "corner.h"

/* Finds the board's markers (or the whole chessboard, or all circles), and then each of its
 * corners. Returns a GArray of struct corner, ordered by id.
 *
 * `fine` is for photographs that calibrate a lens or a laser. If `fine` is TRUE, all corners are
 * fitted again from the positions found, which yields some more corners. A ChArUco board is then
 * also accepted if its first square has the other colour.
 *
 * Returns NULL with BOARD_ERROR_SPEC and a reason such as "no board is visible", to which the
 * caller prefixes "picture: ". If OpenCV fails, the error is PICTURE_FILE_ERROR_FAILED. */
GArray *board_find(const struct picture *picture, const struct board *board, gboolean fine,
                   GError **error);

/* Projects a point of the board to the picture. If straight is TRUE, the point is projected as by a
 * lens without distortion. The difference between the projections with and without distortion gives
 * the curvature of the edges. Returns FALSE if the point is not visible. */
typedef gboolean (*BoardProject)(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                                 gconstpointer data);

/* Shifts the predicted image of the board by up to reach_px in x and y, and takes the shift at
 * which the picture has the largest correlation with the print. Then fits each corner. Returns a
 * GArray of struct corner, ordered by id. *ret_fit gets the largest correlation, −1 … 1. Returns
 * NULL, without an error, if this correlation is too small. */
GArray *board_find_near(const struct picture *picture, const struct board *board,
                        BoardProject project, gconstpointer data, double reach_px, double *ret_fit);

/* Adds the equations of the wanted corners to *lateral, by corner_lateral(). `wanted` has one flag
 * per corner id. The corners must lie within a fraction of a pixel of the places that `project`
 * predicts. Returns the number of corners that were added. */
int board_lateral(const struct picture *picture, const struct board *board, BoardProject project,
                  gconstpointer data, const guint8 *wanted, struct corner_lateral *lateral);
