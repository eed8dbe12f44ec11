/* The file format of a material for WebGL, which renderer/web/material_file.js reads:
 *
 *   bytes 0 … 7     "mesoweb2"; the digit is the version
 *   bytes 8 … 11    length of the header, little-endian
 *   header          JSON in UTF-8: the caller's description of the material, and "sections", an
 *                   array of {"name", "bytes", "size"}: bytes in the file, size after inflating
 *   sections        one after the other, each a zlib stream; its numbers are little-endian
 *
 * One thread at a time. */
#pragma once

#include <glib.h>

typedef struct WebglFile WebglFile;

WebglFile *webgl_file_new(void);
void webgl_file_free(WebglFile *file); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(WebglFile, webgl_file_free)

/* Compresses size bytes of data and appends them as a section. All compressed sections together
 * must have less than 4 GiB; otherwise the program is aborted. */
gboolean webgl_file_add(WebglFile *file, const char *name, gconstpointer data, gsize size,
                        GError **error);

/* Returns the whole file; g_bytes_unref(). Call it once, after all sections are added. info is a
 * dictionary with string keys. It becomes the header, together with "sections". If info is
 * floating, the function takes the reference. */
GBytes *webgl_file_bytes(const WebglFile *file, GVariant *info);
