/*
 * The fit of a session's maps, kept as products/maps_fit.exr, or maps_fit_core.exr of the core
 * model, so that a further export need not fit again. The file names in mesorig.inputs (string)
 * what it was computed from: the checksums of the BTF's files, and the version of the fit. It has
 *   part "texels", float: the members of struct maps_texel, and E, the error of each texel,
 *   part "pairs", float, n_lights × n_views: E, the error of each pair of directions,
 * and in the first part, as attributes, the other members of struct maps that come from the BTF.
 * Any thread.
 */
#pragma once

#include "maps.h"

/* The file of a model, in the session. */
const char *maps_store_product(enum maps_model model);

/* The inputs of a session's fit; g_free() it. NULL: a file of its BTF is not among the session's
 * products, so that it cannot be told whether it has changed. An error, too, is NULL: a damaged
 * BTF. */
char *maps_store_inputs(const char *session, enum maps_model model, GError **error);

/* The fit and errors of these inputs. NULL: there are none, they are of others, or damaged. */
struct maps *maps_store_read(const char *session, enum maps_model model, const char *inputs);

/* FALSE: the session cannot be written to; nothing is changed then. */
gboolean maps_store_write(const char *session, const char *inputs, const struct maps *maps,
                          GError **error);
