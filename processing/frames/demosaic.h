/*
 * Demosaicing: estimates the two colours that a pixel behind a colour filter does not measure.
 * Green is interpolated along edges rather than across them (Hamilton and Adams 1997). The ratios
 * of red and blue to green are averaged over near pixels. Pixels of similar brightness have larger
 * weights, so that colours do not bleed over edges. Any thread.
 */
#pragma once

#include <glib.h>

enum { DEMOSAIC_RED, DEMOSAIC_GREEN, DEMOSAIC_BLUE, DEMOSAIC_COLOURS };

/* Mirrors the index i of a row or column at the first and at the last of n. The mirrored pixel has
 * the same colour filter. */
static inline int demosaic_mirror(int i, int n) {
    i = i < 0 ? -i : i;
    return i < n ? i : MAX(2 * (n - 1) - i, 0);
}

/* Lateral colour of a lens (rig.h): the picture in colour c is larger by the factor 1 + larger[c]
 * about centre_px. */
struct demosaic_lateral {
    double centre_px[2], larger[DEMOSAIC_COLOURS];
};

/* Estimates the colours of the points whose light the pixels see.
 *   mosaic      height × width; values that are negative or not finite count as black
 *   colour      one of the constants above for each pixel, with a Bayer filter's period of two
 *   lateral     NULL if all colours of a point arrive at the same place
 *   ret_ratio   height × width × 3: the factors from a pixel's value to red, green and blue;
 *               1 for the pixel's own colour */
void demosaic_ratios(const float *mosaic, const guint8 *colour, int width, int height,
                     const struct demosaic_lateral *lateral, float *ret_ratio);
