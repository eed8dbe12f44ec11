/* Pictures whose files say something of themselves: tone curves, masks, when they were taken. */
#pragma once

#include <glib.h>

/* What a file is to say; all NULL or 0: nothing. */
struct told {
    const char *png_chunk; /* four letters, for instance "gAMA" */
    const guint8 *chunk;
    gsize chunk_bytes;
    gboolean srgb;     /* the chunk sRGB */
    double icc_gamma;  /* a profile with this curve; 0: none */
    const char *taken; /* EXIF, "2026:11:27 18:57:13" */
    const char *fraction;
    int colour_space; /* EXIF */
};

/* channels: 1 grey, 3 RGB, 4 with opacity; bits: 8 or 16; values: height × width × channels. */
void told_png(const char *path, int width, int height, int channels, int bits,
              const guint16 *values, const struct told *told);
void told_jpeg(const char *path, int width, int height, const guint8 *rgb, const struct told *told);
/* 8 bits; four channels have an opacity. */
void told_tiff(const char *path, int width, int height, int channels, const guint8 *values,
               const struct told *told);
