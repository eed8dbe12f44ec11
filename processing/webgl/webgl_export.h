/* Exports a material for WebGL, as a page or as the file that renderer/web loads. Any thread. */
#pragma once

#include "base/work.h"

#define WEBGL_EXPORT_SIZE ((gint64)20000000) /* bytes, unless another is given */

struct webgl_export {
    const char *path;   /* a session or a compressed material, see webgl_source.h */
    const char *mdf;    /* NULL: the mdf.exr beside it, if there is one */
    const char *output; /* NAME.html: a page; NAME.mesoweb: the material alone */
    gint64 size;        /* of the output, at most */
};

struct webgl_export_result {
    int width, height, clusters, components, levels, grid;
    int mdf_terms;       /* 0: without MDF */
    gboolean compressed; /* the material was compressed for this */
    gint64 bytes;
};

/* Chooses the finest grid of directions, 16 at most, that is sure to fit into size. Replaces an
 * existing output; callers with the name of a user's file go through base/output_file.h. The output
 * appears complete or not at all. Stages of webgl_source.h and webgl_pack.h. */
gboolean webgl_export(const struct webgl_export *asked, const struct work *work,
                      struct webgl_export_result *ret, GError **error);
