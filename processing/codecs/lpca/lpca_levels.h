/* Mip levels of a local PCA. Each level is a local PCA of the BTF with half the texels of the level
 * before in each dimension. */
#pragma once

#include "lpca.h"

#define LPCA_MAX_LEVELS 16

/* Returns a BTF with max(1, n/2) instead of n texels in each dimension, which are means of the
 * texels of btf. texel_mm increases accordingly. Returns NULL for a BTF of one texel. */
struct btf_matrix *btf_matrix_halved(const struct btf_matrix *btf);

/* Writes all levels into one file. The parts of level 0 have the names of lpca.h, so that
 * lpca_read() reads level 0. The parts of level n are named "mip<n>.clusters", "mip<n>.weights" and
 * so on. */
gboolean lpca_write_levels(const char *path, struct lpca *const *levels, int n, GError **error);

/* Reads all levels. Returns the number of levels, or 0 with an error. */
int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error);
