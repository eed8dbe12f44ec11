/* Shared by the files of btf_matrix.h and near_field_correction.h. */
#pragma once

#include "btf_matrix.h"
#include "exr/exr.h"

/* Opens a BTF: everything except lights and values, and the paths of its views. With verify, all
 * files are checked as by session_check_products(), which reports to work. */
struct btf_matrix *btf_open(const char *path, gboolean verify, const struct work *work,
                            GPtrArray **ret_paths, GError **error);

/* Sets the lights from a view's headers. */
gboolean btf_take_lights(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                         GError **error);

/* Reads a view's directions, flags and values from its file. first points to the values of the
 * first texel; values of consecutive texels are stride floats apart. */
gboolean btf_take_view(struct btf_matrix *btf, const struct exr_file *file, int view,
                       const char *path, float *first, gsize stride, GError **error);

/* Writes n texels of a view from texel first on. Does not change the hash of the view. Any thread,
 * also while others read or write other texels. */
gboolean btf_scratch_write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const float *values, GError **error);
