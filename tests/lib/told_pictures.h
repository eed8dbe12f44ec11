/* Picture files with metadata: tone curves, masks, times. */
#pragma once

#include <glib.h>

/* The metadata of a file. NULL or 0 leaves a member out. */
struct told {
    const char *png_chunk; /* four letters, for instance "gAMA" */
    const guint8 *chunk;
    gsize chunk_bytes;
    gboolean srgb;     /* add the chunk sRGB */
    double icc_gamma;  /* gamma of the curve of an ICC profile; 0 means no profile */
    const char *taken; /* time in EXIF, "2026:11:27 18:57:13" */
    const char *fraction;
    int colour_space; /* EXIF */
    /* EXIF: focal length, and resolution of the focal plane, each as numerator and denominator */
    guint32 focal[2], plane[2];
    int plane_unit; /* 2: inch; 3: cm */
    int full_px;    /* width in EXIF */
    int film_mm;    /* focal length on 35 mm film */
};

/* Writes a PNG. channels is 1 for grey, 3 for RGB and 4 for RGB with opacity. bits is 8 or 16.
 * values is height × width × channels. */
void told_png(const char *path, int width, int height, int channels, int bits,
              const guint16 *values, const struct told *told);
void told_jpeg(const char *path, int width, int height, const guint8 *rgb, const struct told *told);
/* Writes a TIFF of 8 bits. The fourth of four channels is opacity. */
void told_tiff(const char *path, int width, int height, int channels, const guint8 *values,
               const struct told *told);
