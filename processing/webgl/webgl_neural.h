/* The sections of neural planes in a material for WebGL (webgl_pack.h). Any thread. */
#pragma once

#include "codecs/neural/neural.h"
#include "webgl_file.h"

gint64 webgl_neural_bytes(const struct neural *neural); /* of all sections before compression */

/* Adds the sections "surface", "heights", "planes", "sky" and "network", and the member "neural" to
 * the header. */
gboolean webgl_neural_add(WebglFile *file, const struct neural *neural, GVariantDict *info,
                          GError **error);
