/*
 * Writes a DNG 1.4 as cameras do, byte by byte after Adobe's specification: a TIFF with one strip
 * of 16 bits, not compressed.
 */
#pragma once

#include <glib.h>

struct dng {
    int width, height;       /* of all pixels */
    const guint16 *values;   /* height × width */
    const char *cfa;         /* "rggb", or "mono" */
    guint32 black[4], white; /* black: of the places of each 2 × 2 of the active area */
    int top, left;           /* of the active area, which ends at the last row and column */
    int repeat;              /* of the filter's pattern, if not 0: written as of so many pixels each
                                way, all green */
};

void write_dng(const char *path, const struct dng *dng);
