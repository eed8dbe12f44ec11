/* Every codec at several sizes of its models: what “mesorig compare DIR --curve” draws. */
#pragma once

#include "plot.h"

/* Array of struct plot_point, series by series and in order of size; of each series only those that
 * no other of it beats in both size and error. Sizes are those in a renderer, of packed local PCAs
 * of their files, written and removed where temporary files are. curve_free() frees it with what
 * points own. */
GArray *curve_measure(const struct btf_matrix *btf, const struct work *work, GError **error);
void curve_free(GArray *points); /* NULL is ignored */
