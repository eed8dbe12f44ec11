/* Reads the source of an export for WebGL from a session or a compressed material. The source is a
 * local PCA in R, G, B, or neural planes. It also has the views and the shell of the MDF. Other
 * forms of a material are converted to a local PCA. Any thread. */
#pragma once

#include "base/work.h"
#include "codecs/lpca/lpca_levels.h"
#include "codecs/neural/neural.h"
#include "mdf/mdf_shell.h"
#include "mdf/mdf_table.h"

struct webgl_source {
    struct lpca *levels[LPCA_MAX_LEVELS];
    int n_levels;            /* 0 for neural planes */
    struct neural *neural;   /* NULL for a local PCA */
    struct mdf_shell *shell; /* NULL if there is no MDF */
    struct mdf_table *views; /* the measured views of the MDF; NULL if there is no MDF */
    gboolean compressed;     /* whether the local PCA was computed for this export */
};

/* Opens a source. path is a file of any codec, or a session. The local PCA of a session is
 * products/lpca.exr; if this file does not exist, the BTF is compressed. mdf is the file of the
 * MDF; NULL means mdf.exr in the folder of the material, if there is one. Progress stages are those
 * of lpca.h and "read". Call webgl_source_clear() afterwards, even if the function fails. */
gboolean webgl_source_open(struct webgl_source *source, const char *path, const char *mdf,
                           const struct work *work, GError **error);
void webgl_source_clear(struct webgl_source *source);
