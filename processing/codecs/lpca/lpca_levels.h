/* Mip levels of a local PCA. Each level is a local PCA of the BTF with half the texels in each
 * dimension. */
#pragma once

#include "lpca.h"

#define LPCA_MAX_LEVELS 16

/* Averages a BTF to max(1, n/2) texels in each dimension, and increases texel_mm accordingly.
 * Returns NULL for a BTF of one texel. */
struct btf_matrix *btf_matrix_halved(const struct btf_matrix *btf);

/* Writes all levels into one file. Level 0 is written as by lpca_write(), so that lpca_read() reads
 * it. The parts of level n are named "mip<n>.clusters", "mip<n>.weights" and so on. */
gboolean lpca_write_levels(const char *path, struct lpca *const *levels, int n, GError **error);

/* Reads all levels. Returns the number of levels, or 0 with an error. */
int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error);
