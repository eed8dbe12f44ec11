/*
 * Pictures from files: JPEG, PNG, TIFF, BMP and portable anymaps (PGM, PPM). EXIF orientation is
 * ignored: pixels stay as on the sensor. The size in the header is checked before anything is
 * decoded. Errors are PICTURE_FILE_ERROR and INPUT_FILE_ERROR. Any thread.
 */
#pragma once

#include "picture.h"

G_BEGIN_DECLS

/* Reads a picture as grey, camera raw as raw_read_grey(). Files of 8 bits are taken as sRGB and
 * made linear, others as linear; 1 is white. */
struct picture *picture_read(const char *path, GError **error);

/* The same in colour, but without camera raw: height × width × 3 (R, G, B), g_free(). ret_grey: the
 * file is grey and all three are equal. */
gboolean picture_read_colour(const char *path, int *ret_width, int *ret_height, gboolean *ret_grey,
                             float **ret_rgb, GError **error);

/* The same without a conversion: the numbers in the file. ret_bits: 8 or 16 of each number; 0: it
 * is a floating-point number. */
gboolean picture_read_codes(const char *path, int *ret_width, int *ret_height, gboolean *ret_grey,
                            int *ret_bits, float **ret_rgb, GError **error);

G_END_DECLS
