/* The transfer curve of sRGB (IEC 61966-2-1), and its inverse. Any thread may call the functions.
 */
#pragma once

#include <math.h>

/* Convert a linear value to the sRGB value and back. 0 is black and 1 is white in both. Values
 * outside 0 … 1 are not limited. */
static inline double srgb_encode(double linear) {
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

static inline double srgb_decode(double coded) {
    return coded <= 0.04045 ? coded / 12.92 : pow((coded + 0.055) / 1.055, 2.4);
}
