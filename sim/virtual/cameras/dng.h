/*
 * Makes a DNG 1.4 file as a camera does, byte by byte according to Adobe's specification. The file
 * is a TIFF with one uncompressed strip of 16 bits. Any thread may call the function.
 */
#pragma once

#include <glib.h>

struct dng {
    int width, height;     /* size of the whole picture */
    const guint16 *values; /* height × width */
    const char *cfa;       /* "rggb", or "mono" */
    /* `black`: black level of each position in the 2 × 2 cell of the active area. `white`: value of
     * a saturated pixel. */
    guint32 black[4], white;
    int top, left; /* first row and column of the active area, which extends to the last ones */
    /* A fault: if not 0, the pattern of the colour filters is written as repeat × repeat green
     * pixels. */
    int repeat;
};

/* Returns the bytes of the file. The caller owns the returned GBytes. */
GBytes *dng_new(const struct dng *dng);
