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

/* Compresses size bytes of data and adds them as a section at the end. All compressed sections
 * together must have less than 4 GiB, otherwise the program ends. */
gboolean webgl_file_add(WebglFile *file, const char *name, gconstpointer data, gsize size,
                        GError **error);

/* Returns the whole file. Call it once, after all sections are added. info is a dictionary
 * with string keys, which becomes the header with "sections" added. If info is floating, the
 * function takes the reference. g_bytes_unref() */
GBytes *webgl_file_bytes(const WebglFile *file, GVariant *info);
