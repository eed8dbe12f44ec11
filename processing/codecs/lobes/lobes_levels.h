/* Mip levels of an analytic model. The parameters of a model cannot be averaged, because
 * reflectance is not linear in the parameters. Each level is therefore a separate model. It is
 * fitted to the BTF with half the texels of the level before in each dimension
 * (btf_matrix_halved()). A PTM is not linear either, because its colour multiplies its
 * polynomial. */
#pragma once

#include "codecs/lpca/lpca_levels.h"
#include "lobes.h"

#define LOBES_MAX_LEVELS LPCA_MAX_LEVELS

/* Computes all levels, from level 0, the model of lobes_compute(), down to a level of one texel,
 * but at most LOBES_MAX_LEVELS levels. Returns the number of levels, or 0 with an error. A
 * checkpoint holds only level 0. */
int lobes_compute_levels(const struct btf_matrix *btf, const struct lobes_options *options,
                         struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);

/* Writes all levels into one file. lobes_read() reads level 0 of this file. The parts of level n
 * have the names of the parts of level 0 with the prefix "mip<n>.". */
gboolean lobes_write_levels(const char *path, struct lobes *const *levels, int n, GError **error);

/* Reads all levels of a file. Returns the number of levels, or 0 with an error. */
int lobes_read_levels(const char *path, struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error);
