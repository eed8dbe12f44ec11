/* The fit of a session's maps, stored as products/maps_fit.exr (maps_fit_core.exr for the core
 * model) so that a further export need not repeat the fit. The attribute mesorig.inputs (string)
 * names the inputs from which it was computed: the checksums of the BTF's files, and the version of
 * the fit. The file has
 *   part "texels", float: the members of struct maps_texel, and E, the error of each texel,
 *   part "pairs", float, n_lights × n_views: E, the error of each pair of directions.
 * The attributes of the first part are the other members of struct maps that come from the BTF. Any
 * thread. */
#pragma once

#include "maps.h"

/* Returns the path of a model's file, relative to the session. */
const char *maps_store_product(enum maps_model model);

/* Returns the inputs of a session's fit; g_free(). Returns NULL without an error if a file of the
 * BTF is not among the session's products, because it is then not known whether the file has
 * changed. Returns NULL with an error if the BTF is damaged. */
char *maps_store_inputs(const char *session, enum maps_model model, GError **error);

/* Returns the fit and the errors for these inputs. Returns NULL if there are none, if they are for
 * other inputs, or if they are damaged. */
struct maps *maps_store_read(const char *session, enum maps_model model, const char *inputs);

/* Stores a fit. Returns FALSE if the session cannot be written to; nothing is changed then. */
gboolean maps_store_write(const char *session, const char *inputs, const struct maps *maps,
                          GError **error);
