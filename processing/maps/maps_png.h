/* Pictures of any number of channels as PNG. Any thread. */
#pragma once

#include <gio/gio.h>

/* values: height × width × channels (1 grey, 3 RGB, 4 RGBA), in 0 … 1, what lies outside is cut
 * off; row 0 at the top. bits: 8 or 16. srgb: R, G and B are linear light, and are encoded as sRGB.
 */
GBytes *maps_png(const float *values, int width, int height, int channels, int bits, gboolean srgb,
                 GError **error);

/* sRGB's transfer curve (IEC 61966-2-1), and a value as 8 bits of it give it back. */
float maps_srgb_encode(float linear);
float maps_srgb_decode(float coded);
float maps_srgb_round(float linear);
