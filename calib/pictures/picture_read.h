/*
 * This module reads pictures from JPEG, PNG, TIFF, BMP and portable anymap (PGM, PPM) files. EXIF
 * orientation is ignored: pixels stay as on the sensor. The size in the header is checked before
 * anything is decoded. Errors are PICTURE_FILE_ERROR, INPUT_FILE_ERROR and, for errors of the
 * system, G_FILE_ERROR. Any thread may call the functions.
 */
#pragma once

#include "picture.h"
#include "picture_says.h"

G_BEGIN_DECLS

/* Reads a picture as grey values. A camera raw file is read with raw_read_grey(). The values of
 * other files are made linear with the tone curve that the file gives. If the file gives no tone
 * curve, 8 bits are taken as sRGB, and other numbers as linear. 1 is white. */
struct picture *picture_read(const char *path, GError **error);

/* The numbers of a colour picture that is not camera raw. */
typedef struct picture_codes {
    int width, height;
    gboolean grey;            /* the file is grey, and all three numbers are equal */
    int bits;                 /* 8 or 16 bits of each number; 0 for floating-point numbers */
    gsize transparent;        /* number of pixels that are not opaque; their numbers are NaN */
    float *rgb;               /* height × width × 3 (R, G, B) */
    struct picture_says says; /* picture_tone_apply() makes the numbers linear */
} PictureCodes;

/* Reads a picture in colour. After success, call picture_codes_clear(). */
gboolean picture_read_codes(const char *path, struct picture_codes *ret, GError **error);
void picture_codes_clear(struct picture_codes *codes);
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(PictureCodes, picture_codes_clear)

G_END_DECLS
