/*
 * What is exported for WebGL, from a session or a compressed material: a local PCA in R, G, B, and
 * the MDF as factors. Other forms are converted. Any thread.
 */
#pragma once

#include "base/work.h"
#include "lpca/lpca_levels.h"
#include "mdf_codecs/mdf_factors.h"

struct webgl_source {
    struct lpca *levels[LPCA_MAX_LEVELS];
    int n_levels;
    struct mdf_factors *mdf; /* NULL: there is none */
    gboolean compressed;     /* the local PCA was computed for this */
};

/* path: a session, whose products/lpca.exr is taken, else its BTF is compressed; or a file of any
 * codec. mdf: the file; NULL: the mdf.exr beside it, if there is one. Stages of lpca.h and "read".
 * webgl_source_clear() afterwards, also after an error. */
gboolean webgl_source_open(struct webgl_source *source, const char *path, const char *mdf,
                           const struct work *work, GError **error);
void webgl_source_clear(struct webgl_source *source);
