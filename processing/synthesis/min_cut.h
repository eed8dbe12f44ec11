/* Minimum-error cuts: the path of minimum cost through a strip, from its first row to its last
 * (Efros and Freeman 2001 §2.1), found by dynamic programming. */
#pragma once

#include <glib.h>

/* costs is length × width: the cost of a cut through a column of a row. The column of the path
 * changes by at most 1 from row to row. turns, which may be NULL, is length × width × 2: the
 * additional cost of going from (row, column) to column − 1 and + 1 of the next row. If cyclic is
 * TRUE, the first row follows the last, so that the path is closed. Returns the cost of the path.
 * ret_path gets the column of the path in each of the length rows. */
float min_cut(const float *costs, const float *turns, int length, int width, gboolean cyclic,
              int *ret_path);
