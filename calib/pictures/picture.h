/*
 * Pictures as calibration sees them: one grey value a pixel, linear in light, and where they are
 * from. Any thread.
 */
#pragma once

#include <gio/gio.h>

G_BEGIN_DECLS

struct picture {
    char *name;     /* for messages: a path */
    char *checksum; /* SHA-256 of the file, 64 hexadecimal digits */
    int width, height;
    float *values; /* height rows of width, top row first */
};

struct picture *picture_new(const char *name, const char *checksum, int width, int height);
void picture_free(struct picture *picture); /* NULL is ignored */
typedef struct picture Picture;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Picture, picture_free)

/* The grey values of a mosaic ("mono", "rggb", "bggr", "grbg", "gbrg"): each colour is scaled so
 * that the picture as a whole is grey, and then a pixel's value is taken as it is. Exact, and as
 * sharp as the sensor, where what is seen is grey under one light; else the mosaic stays visible.
 * FALSE: unknown name. */
gboolean picture_balance(struct picture *picture, const char *cfa);

G_END_DECLS
