/*
 * The module mesorig-picture-codecs.so has OpenCV's codecs for JPEG, PNG, TIFF, BMP and portable
 * anymaps behind a C interface. The codecs need 140 shared libraries, which take longer to load
 * than most commands take to run. picture_read.c therefore loads the module when it reads the first
 * picture. Any thread may call the function.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

#define PICTURE_CODECS_MODULE "mesorig-picture-codecs.so"
#define PICTURE_CODECS_DECODE "picture_codecs_decode" /* the name of the function below */

struct picture_pixels {
    int width, height;
    int channels;    /* 1: grey; 3: B, G, R; 4: B, G, R and opacity */
    int bits;        /* bits of a value: 8 (guint8), 16 (guint16); 0 for float */
    gpointer values; /* height × width × channels; g_free() */
};

enum picture_channels {
    PICTURE_GREY,   /* as one channel, also if the file has colours */
    PICTURE_COLOUR, /* one or three channels, as in the file */
    PICTURE_ALPHA,  /* also four channels, if the file has transparent pixels */
};

/* Decodes a whole file. EXIF orientation is ignored. Returns FALSE if the file is not a picture
 * that these codecs read. *ret_what is then OpenCV's message, to be freed with g_free(), or
 * NULL. */
typedef gboolean PictureCodecsDecode(const guint8 *bytes, gsize length,
                                     enum picture_channels channels, struct picture_pixels *ret,
                                     char **ret_what);

G_END_DECLS
