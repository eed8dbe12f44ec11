/*
 * This module reads the size of JPEG, PNG, TIFF, BMP and portable anymap (PGM, PPM) files before
 * the files are decoded. Any thread may call the function.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* Returns TRUE if the size is allowed. Returns FALSE with an error if the file has none of these
 * formats, or if the picture is larger than input_file_check_pixels() allows. A TIFF with more than
 * 16 bits per value may have only half as many pixels. Other errors in a header are left to the
 * decoder. */
gboolean picture_header_check(const char *path, const guint8 *bytes, gsize length, GError **error);

G_END_DECLS
