/* Encodes pictures with 1, 3 or 4 channels as PNG. Any thread. */
#pragma once

#include <glib.h>

/* Returns the bytes of a PNG file. values is height × width × channels (1 grey, 3 RGB, 4 RGBA),
 * with row 0 at the top. Values are clamped to 0 … 1. bits is 8 or 16. If srgb is TRUE, grey or R,
 * G and B are linear light, and are encoded as sRGB. */
GBytes *maps_png(const float *values, int width, int height, int channels, int bits, gboolean srgb,
                 GError **error);

/* maps_srgb_encode() is the transfer curve of sRGB (IEC 61966-2-1), maps_srgb_decode() its inverse.
 * maps_srgb_round() rounds linear light to the nearest 8-bit code of sRGB, and returns linear
 * light. */
float maps_srgb_encode(float linear);
float maps_srgb_decode(float coded);
float maps_srgb_round(float linear);
