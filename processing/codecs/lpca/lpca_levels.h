/* Mip levels of a local PCA: each level is a local PCA of the BTF with half the texels each way. */
#pragma once

#include "lpca.h"

#define LPCA_MAX_LEVELS 16

/* Averages a BTF to max(1, n/2) texels each way, with texel_mm increased accordingly. NULL for one
 * texel. */
struct btf_matrix *btf_matrix_halved(const struct btf_matrix *btf);

/* Writes all levels into one file: level 0 as lpca_write() does, so that lpca_read() reads it; the
 * parts of level n are named "mip<n>.clusters", "mip<n>.weights" and so on. */
gboolean lpca_write_levels(const char *path, struct lpca *const *levels, int n, GError **error);

/* Reads all of them. Returns their number; 0 with an error. */
int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error);
