/*
 * Converts the picture of a still camera to a PGM of 16 bits, linear in light: the values of the
 * sensor without demosaicing. Black and white come from the raw file. Both are the same in all PGM
 * files, also if the camera's black level changes. Any thread.
 */
#pragma once

#include <gio/gio.h>

#define CONVERT_BITS  16
#define CONVERT_BLACK 1024  /* of a pixel that is black in the file */
#define CONVERT_WHITE 65535 /* of a pixel that is white in the file, or above */

struct converted {
    int width, height;
    gboolean raw;
    char cfa[5]; /* "mono", "rggb", "bggr", "grbg" or "gbrg" */
};

/* Reads a raw file with LibRaw, in a separate program (pictures/picture_child.h). Any other picture
 * is a JPEG: its numbers are made linear with the tone curve of the file, or of sRGB. A JPEG in
 * colour becomes a mosaic "rggb" of its own pixels. Errors are those of pictures/picture_read.h,
 * and G_FILE_ERROR. */
gboolean convert_to_pgm(const char *path, const char *pgm, struct converted *ret, GError **error);
