/* Measures every codec at several sizes of its models, for “mesorig compare DIR --curve”. */
#pragma once

#include "common/plot.h"

/* Returns an array of struct plot_point, series by series and in order of size. A point is left out
 * if another point of its series has both a smaller size and a smaller error. The size is the size
 * in a renderer. For a packed local PCA it is the size of the file, which is written to the folder
 * for temporary files and removed. curve_free() frees the array and the strings of its points. */
GArray *curve_measure(const struct btf_matrix *btf, const struct work *work, GError **error);
void curve_free(GArray *points); /* NULL is ignored */
