/* Measures every codec at several sizes of its models, for “mesorig compare DIR --curve”. */
#pragma once

#include "codecs/codec/held_out.h"
#include "common/plot.h"

/* Encodes the BTF without the directions of `held`, and measures the errors at these directions. If
 * `held` is NULL, the errors are those at the measured directions, which the codecs have seen.
 *
 * Returns an array of struct plot_point, series by series and in order of size. A point is left out
 * if its series has a point of smaller size whose error is not larger. The size is that in a
 * renderer. For a packed local PCA it is that of the file, which is written to the folder for
 * temporary files and then removed. Returns NULL on error. curve_free() frees the array and the
 * strings of its points. */
GArray *curve_measure(const struct btf_matrix *btf, const struct held_out *held,
                      const struct work *work, GError **error);
void curve_free(GArray *points); /* NULL is ignored */
