/*
 * This module makes a DNG 1.4 file as a camera does, byte by byte according to Adobe's
 * specification. The file is a TIFF with one uncompressed strip of 16 bits. Any thread may call the
 * function.
 */
#pragma once

#include <glib.h>

struct dng {
    int width, height;     /* size of the whole picture */
    const guint16 *values; /* height × width */
    const char *cfa;       /* "rggb", or "mono" */
    /* black is the level of each position in the 2 × 2 cell of the active area */
    guint32 black[4], white;
    int top, left; /* origin of the active area, which extends to the last row and column */
    /* if not 0: the filter's pattern is written as repeat × repeat pixels, all green */
    int repeat;
};

/* Returns the bytes of the file. The caller owns the returned GBytes. */
GBytes *dng_new(const struct dng *dng);
