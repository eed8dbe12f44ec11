/*
 * Converts the picture of a still camera to a PGM of 16 bits, linear in light: the values of the
 * sensor without demosaicing. The raw file states the sensor's values for black and white. They
 * become CONVERT_BLACK and CONVERT_WHITE in each PGM, also if the camera's black level changes. Any
 * thread may call the function.
 */
#pragma once

#include <glib.h>

#define CONVERT_BITS 16
/* Values in the PGM of a pixel that is black in the raw file, and of one that is white or
 * brighter. */
#define CONVERT_BLACK 1024
#define CONVERT_WHITE 65535

struct converted {
    int width, height;
    gboolean raw; /* the picture was a raw file */
    char cfa[5];  /* "mono", "rggb", "bggr", "grbg" or "gbrg" */
};

/* Reads a raw file with LibRaw, in a separate program (pictures/picture_child.h). Any other picture
 * is a JPEG: its numbers are made linear with the tone curve of the file, or of sRGB. Of each pixel
 * of a JPEG in colour, only the colour that this pixel has in a mosaic "rggb" is kept. Errors are
 * those of pictures/picture_read.h, and G_FILE_ERROR. */
gboolean convert_to_pgm(const char *path, const char *pgm, struct converted *ret, GError **error);
