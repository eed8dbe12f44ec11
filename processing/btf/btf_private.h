/* What the files of btf_matrix.h and near_field_correction.h share. */
#pragma once

#include "btf_matrix.h"
#include "exr/exr.h"

/* Everything but lights and values, and the files of its views. verify: all of them are checked, as
 * session_check_products() does. */
struct btf_matrix *btf_open(const char *path, gboolean verify, GPtrArray **ret_paths,
                            GError **error);

/* Of a view's headers. */
gboolean btf_take_lights(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                         GError **error);

/* A view's directions, holes and values: those of a texel lie stride behind those of the last. */
gboolean btf_take_view(struct btf_matrix *btf, const struct exr_file *file, int view,
                       const char *path, float *first, gsize stride, GError **error);

/* Of n texels from first on alone; any thread, as reading. */
gboolean btf_scratch_write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const float *values, GError **error);
