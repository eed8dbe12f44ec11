/* Pictures as PNG. Any thread. */
#pragma once

#include <gio/gio.h>

/* A whole PNG file, 8 bits sRGB. rgb: height rows of width pixels, R, G, B each, the top row first.
 * NULL with an error: not a picture, or too large. */
GBytes *png_bytes(const guint8 *rgb, int width, int height, GError **error);
