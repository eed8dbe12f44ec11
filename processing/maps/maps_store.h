/* Stores the fit of a session's maps as products/maps_fit.exr (maps_fit_core.exr for the core
 * model), so that a later export need not repeat the fit. The attribute mesorig.inputs (string) is
 * a checksum of the inputs of the fit: the checksums of the BTF's files, and the version of the
 * fit. The file has
 *   part "texels", float: the members of struct maps_texel, and E, the error of each texel,
 *   part "pairs", float, n_lights × n_views: E, the error of each pair of directions.
 * The attributes of the first part are the other members of struct maps that come from the BTF. Any
 * thread. */
#pragma once

#include "maps.h"

/* Returns the path of a model's file, relative to the session. */
const char *maps_store_product(enum maps_model model);

/* Returns the value of mesorig.inputs for the present BTF of a session; g_free(). Returns NULL
 * without an error if a file of the BTF is not among the session's products, because it is then not
 * known whether the file has changed. Returns NULL with an error if the session cannot be read, or
 * if its BTF is missing or damaged. */
char *maps_store_inputs(const char *session, enum maps_model model, GError **error);

/* Returns the stored fit and its errors. Returns NULL if none is stored, if the stored fit has
 * other inputs, or if the file is damaged. */
struct maps *maps_store_read(const char *session, enum maps_model model, const char *inputs);

/* Stores a fit. Returns FALSE with an error if the file, or its row in the session, cannot be
 * written. If only the row cannot be written, the new file stays. */
gboolean maps_store_write(const char *session, const char *inputs, const struct maps *maps,
                          GError **error);
