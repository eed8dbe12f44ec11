/* Exports a material for WebGL, as a page or as the file that renderer/web loads. Any thread. */
#pragma once

#include "base/work.h"

#define WEBGL_EXPORT_SIZE ((gint64)20000000) /* default size in bytes */

struct webgl_export {
    const char *path;   /* a session or a compressed material, see webgl_source.h */
    const char *mdf;    /* NULL means the mdf.exr in the same folder, if there is one */
    const char *output; /* NAME.html for a page, NAME.mesoweb for the material without a page */
    gint64 size;        /* maximum size of the output in bytes */
};

struct webgl_export_result {
    int width, height, clusters, components, levels, grid;
    gboolean shell;      /* whether there is an MDF, from which the shell is made */
    gboolean compressed; /* whether the material was compressed for this export */
    gint64 bytes;
};

/* Exports with the finest grid of directions, at most 16, that is certain to fit into size.
 * Replaces an existing output. Callers with the name of a user's file must use base/output_file.h.
 * The output appears complete or not at all. Progress stages are those of webgl_source.h and
 * webgl_pack.h. */
gboolean webgl_export(const struct webgl_export *asked, const struct work *work,
                      struct webgl_export_result *ret, GError **error);
