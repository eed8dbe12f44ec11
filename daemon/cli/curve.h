/* Every codec at several sizes of its models: what “mesorig compare DIR --curve” draws. */
#pragma once

#include "plot.h"

/* Returns an array of struct plot_point, series by series and in order of size. A point is left out
 * if another one of its series beats it in both size and error. The size is that in a renderer; for
 * a packed local PCA it is the size of the file, which is written to the folder for temporary files
 * and removed. curve_free() frees the array with what its points own. */
GArray *curve_measure(const struct btf_matrix *btf, const struct work *work, GError **error);
void curve_free(GArray *points); /* NULL is ignored */
