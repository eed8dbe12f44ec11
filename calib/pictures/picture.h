/*
 * A picture for calibration has one grey value per pixel, linear in light, and the source of the
 * picture. Any thread may call the functions.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

#define PICTURE_FILE_ERROR picture_file_error_quark()
GQuark picture_file_error_quark(void);
enum picture_file_error {
    PICTURE_FILE_ERROR_IO,     /* a picture cannot be read */
    PICTURE_FILE_ERROR_FAILED, /* a library failed */
};

struct picture {
    char *name;     /* for messages: a path */
    char *checksum; /* SHA-256 of the file, 64 hexadecimal digits */
    int width, height;
    char cfa[5];   /* colour filter of the pixels, such as "rggb"; "" for grey pictures */
    float *values; /* height × width, top row first */
};

/* Makes a picture whose values are 0. The strings are copied. */
struct picture *picture_new(const char *name, const char *checksum, int width, int height);
void picture_free(struct picture *picture); /* NULL is ignored */
typedef struct picture Picture;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Picture, picture_free)

/* Gives a table of the light of each 8-bit sRGB number (IEC 61966-2-1), from 0 to 1. */
void picture_srgb(float ret[256]);

/* Makes grey values from a mosaic ("rggb", "bggr", "grbg" or "gbrg"), and sets the picture's cfa.
 * Each colour is scaled so that the picture is grey on average; the pixels are not interpolated. If
 * the scene is grey under one light, the result is exact and as sharp as the sensor. Otherwise the
 * mosaic stays visible. "mono" changes nothing. Returns FALSE if cfa is not one of these names. */
gboolean picture_balance(struct picture *picture, const char *cfa);

G_END_DECLS
