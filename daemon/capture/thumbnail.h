/* A small picture of a camera's frame, for people: colour filters merged, at most THUMBNAIL_SIDE
 * pixels wide and high, white at the 99th percentile, sRGB. Pure function; any thread. */
#pragma once

#include "drivers/frame.h"

#define THUMBNAIL_SIDE 320

/* ret_rgb: width × height × 3, g_free(). */
void thumbnail_make(const Frame *frame, int *ret_width, int *ret_height, guint8 **ret_rgb);

/* The same with at most this many pixels; a colour filter's tile is one at least. */
void thumbnail_make_sized(const Frame *frame, int most_pixels, int *ret_width, int *ret_height,
                          guint8 **ret_rgb);
