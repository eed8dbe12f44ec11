/* Every model of a material at several sizes: what “mesorig compare DIR --curve” draws. */
#pragma once

#include "mesorig_plot.h"

/* Array of struct plot_point, series by series and in order of size; of local PCAs only those that
 * no other beats in both size and error. Frees what points own with curve_free(). */
GArray *curve_measure(const struct btf_matrix *btf, PipelineFunc progress, gpointer data,
                      GCancellable *cancellable, GError **error);
void curve_free(GArray *points); /* NULL is ignored */
