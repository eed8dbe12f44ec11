/* Minimum-error cuts: a path through a strip, from its first row to its last, of least cost (Efros
 * and Freeman 2001 §2.1), by dynamic programming. */
#pragma once

#include <glib.h>

/*
 * costs: length × width, the cost of a cut through a column of a row. The path's column changes by
 * at most 1 from row to row; turns, which may be NULL, is length × width × 2: the further cost of
 * going from (row, column) to column − 1 and + 1 of the next row. cyclic: the last row goes on into
 * the first. Returns the cost; ret_path: length columns.
 */
float min_cut(const float *costs, const float *turns, int length, int width, gboolean cyclic,
              int *ret_path);
