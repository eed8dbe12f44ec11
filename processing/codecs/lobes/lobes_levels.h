/*
 * Mip levels of an analytic model. Its parameters cannot be averaged, for reflectance is not linear
 * in them: each level is a model of its own, fitted again to the BTF with half the texels each way
 * (btf_matrix_halved()). A polynomial with one colour is not linear either: its colour multiplies
 * it.
 */
#pragma once

#include "lobes.h"
#include "lpca/lpca_levels.h"

#define LOBES_MAX_LEVELS LPCA_MAX_LEVELS

/* Level 0 as lobes_compute() has it, and all others down to one texel. Returns their number, or 0
 * with an error. A checkpoint holds level 0 alone. */
int lobes_compute_levels(const struct btf_matrix *btf, const struct lobes_options *options,
                         struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);

/* One file: level 0 as lobes_write() has it, which lobes_read() reads; the parts of level n, all of
 * them, are named "mip<n>." and then as those of level 0. */
gboolean lobes_write_levels(const char *path, struct lobes *const *levels, int n, GError **error);

/* Reads all levels of a file. Returns their number, or 0 with an error. */
int lobes_read_levels(const char *path, struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);
