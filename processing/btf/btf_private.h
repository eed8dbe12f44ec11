/* Shared by the files of btf_matrix.h and near_field_correction.h. */
#pragma once

#include "btf_matrix.h"
#include "exr/exr.h"

/* Opens a BTF: everything but lights and values, and the paths of its views. verify: check all
 * files as session_check_products() does; work is for that. */
struct btf_matrix *btf_open(const char *path, gboolean verify, const struct work *work,
                            GPtrArray **ret_paths, GError **error);

/* Sets the lights from a view's headers. */
gboolean btf_take_lights(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                         GError **error);

/* Takes a view's directions, flags and values from its file. Values of consecutive texels are
 * stride floats apart, those of the first texel at first. */
gboolean btf_take_view(struct btf_matrix *btf, const struct exr_file *file, int view,
                       const char *path, float *first, gsize stride, GError **error);

/* Writes n texels from first on. Any thread, like reading. */
gboolean btf_scratch_write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const float *values, GError **error);
