/*
 * Mip levels of an analytic model. Its parameters cannot be averaged, for reflectance is not linear
 * in them: each level is a model of its own, fitted again to the BTF with half the texels each way
 * (btf_matrix_halved()). A PTM is not linear in its parameters either, since its colour multiplies
 * the polynomial.
 */
#pragma once

#include "lobes.h"
#include "lpca/lpca_levels.h"

#define LOBES_MAX_LEVELS LPCA_MAX_LEVELS

/* Computes level 0, as lobes_compute() does, and all further ones down to one texel. Returns their
 * number, or 0 with an error. A checkpoint holds level 0 alone. */
int lobes_compute_levels(const struct btf_matrix *btf, const struct lobes_options *options,
                         struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);

/* Writes all levels into one file: level 0 as lobes_write() does, so that lobes_read() reads it;
 * all parts of level n have the names of those of level 0 with the prefix "mip<n>.". */
gboolean lobes_write_levels(const char *path, struct lobes *const *levels, int n, GError **error);

/* Reads all levels of a file. Returns their number, or 0 with an error. */
int lobes_read_levels(const char *path, struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);
