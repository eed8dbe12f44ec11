/*
 * Demosaicing: estimates the two colours that a pixel behind a colour filter does not measure.
 * Green, which half of the pixels measure, is interpolated along edges rather than across them
 * (Hamilton and Adams 1997). Red and blue follow green: their ratio to green is averaged over
 * near pixels, with larger weights for pixels of similar brightness, so that colours do not bleed
 * over edges. Any thread.
 */
#pragma once

#include <glib.h>

enum { DEMOSAIC_RED, DEMOSAIC_GREEN, DEMOSAIC_BLUE, DEMOSAIC_COLOURS };

/* Index of row or column i of n. Beyond the border a picture is mirrored about its outermost
 * pixels, which preserves the phase of the colour filter. */
static inline int demosaic_mirror(int i, int n) {
    i = i < 0 ? -i : i;
    return i < n ? i : MAX(2 * (n - 1) - i, 0);
}

/* mosaic: height × width; values that are not finite count as black. colour: of each pixel one of
 * the constants above, with the period of two of a Bayer filter. ret_ratio: height × width × 3,
 * the factors by which a pixel's value becomes red, green and blue; the factor of its own colour
 * is 1. */
void demosaic_ratios(const float *mosaic, const guint8 *colour, int width, int height,
                     float *ret_ratio);
