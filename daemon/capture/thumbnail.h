/* A small picture of a camera's frame, for people. Each of its pixels is the mean of a square of
 * pixels of the frame, which has whole tiles of the colour filter. The picture is at most
 * THUMBNAIL_SIDE pixels wide and high, in sRGB, with the 99th percentile as white. The functions
 * are pure, and any thread may call them. */
#pragma once

#include "drivers/frame.h"

#define THUMBNAIL_SIDE 320

struct capture_thumbnail {
    int width, height;
    guint8 *rgb; /* width × height × 3 */
    double time_s;
};

/* Makes a thumbnail. *ret_width and *ret_height are its size in pixels. *ret_rgb has *ret_height
 * rows of *ret_width pixels of 3 bytes; g_free(). */
void thumbnail_make(const Frame *frame, int *ret_width, int *ret_height, guint8 **ret_rgb);

/* The same as thumbnail_make(), with at most max_pixels pixels in width and in height. Each pixel
 * covers at least one tile of the colour filter. */
void thumbnail_make_sized(const Frame *frame, int max_pixels, int *ret_width, int *ret_height,
                          guint8 **ret_rgb);
