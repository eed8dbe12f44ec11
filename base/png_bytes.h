/* Pictures as PNG. Any thread may call the functions. */
#pragma once

#include <glib.h>

/* Returns a whole PNG file with 8 bits of sRGB per channel. rgb has height rows of width pixels of
 * R, G, B, the top row first. Returns NULL with an error if the size is zero or too large. */
GBytes *png_bytes(const guint8 *rgb, int width, int height, GError **error);
