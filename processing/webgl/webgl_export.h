/* Exports a material for WebGL, as a page or as the file that renderer/web loads. Any thread. */
#pragma once

#include "base/work.h"

#define WEBGL_EXPORT_SIZE ((gint64)20000000) /* default size in bytes */

struct webgl_export {
    const char *path; /* a session or a compressed material, see webgl_source.h */
    /* file of the MDF; NULL means mdf.exr in the folder of the material, if there is one */
    const char *mdf;
    const char *output; /* NAME.html for a page, NAME.mesoweb for the material without a page */
    gint64 size;        /* maximum size of the output in bytes */
};

struct webgl_export_result {
    int width, height;
    int clusters, components, levels, grid; /* 0 for neural planes */
    int channels;                           /* of neural planes; 0 for a local PCA */
    gboolean shell;      /* whether there is an MDF, from which the shell is made */
    gboolean compressed; /* whether the material was compressed for this export */
    gint64 bytes;
};

/* Exports with the finest grid of directions (n × n, n at most 16) with which the output is certain
 * to have at most `size` bytes. The error is DATA_ERROR_INVALID if not even the coarsest grid fits.
 * Progress stages are those of webgl_source.h and webgl_pack.h.
 *
 * An existing output is replaced. Callers must check a name that a user gave before the call
 * (base/output_file.h). The output appears complete or not at all. */
gboolean webgl_export(const struct webgl_export *asked, const struct work *work,
                      struct webgl_export_result *ret, GError **error);
