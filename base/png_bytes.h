/* Pictures as PNG. Any thread. */
#pragma once

#include <gio/gio.h>

/* Returns a whole PNG file, 8 bits sRGB. rgb: height rows of width pixels of R, G, B, the top row
 * first. NULL with an error: the size is zero or too large. */
GBytes *png_bytes(const guint8 *rgb, int width, int height, GError **error);
