/* Mip levels of an analytic model. Its parameters cannot be averaged, because reflectance is not
 * linear in them. Each level is therefore a separate model, fitted to the BTF with half the texels
 * in each dimension (btf_matrix_halved()). This also holds for a PTM, because its colour multiplies
 * the polynomial. */
#pragma once

#include "codecs/lpca/lpca_levels.h"
#include "lobes.h"

#define LOBES_MAX_LEVELS LPCA_MAX_LEVELS

/* Computes level 0 as lobes_compute() does, and all further levels down to one texel, but at most
 * LOBES_MAX_LEVELS levels. Returns the number of levels, or 0 with an error. A checkpoint holds
 * only level 0. */
int lobes_compute_levels(const struct btf_matrix *btf, const struct lobes_options *options,
                         struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);

/* Writes all levels into one file. lobes_read() reads level 0 of it. The parts of level n have the
 * names of the parts of level 0 with the prefix "mip<n>.". */
gboolean lobes_write_levels(const char *path, struct lobes *const *levels, int n, GError **error);

/* Reads all levels of a file. Returns the number of levels, or 0 with an error. */
int lobes_read_levels(const char *path, struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);
