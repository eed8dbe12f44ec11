/* Minimum-error cuts: the path of minimum cost through a strip, from its first row to its last
 * (Efros and Freeman 2001 §2.1), found by dynamic programming. */
#pragma once

#include <glib.h>

/* Finds the path of minimum cost, and returns its cost. ret_path receives the column of the path in
 * each of the length rows. The column changes by at most 1 from row to row. costs (length × width)
 * has the cost of a path through a column of a row.
 *
 * turns, which may be NULL, is length × width × 2. It has the additional cost of going from (row,
 * column) to column − 1, and that of going to column + 1, of the next row. If cyclic is TRUE, the
 * first row follows the last, so that the path is closed. */
float min_cut(const float *costs, const float *turns, int length, int width, gboolean cyclic,
              int *ret_path);
