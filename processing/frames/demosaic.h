/*
 * The two colours that a pixel of a colour filter does not see, from its neighbours. Green, which
 * has half of the pixels, is interpolated along edges rather than across them (Hamilton and Adams
 * 1997); red and blue follow it: their ratio to green is the mean of that of near pixels, those
 * first that are as bright, so that colours do not bleed over edges. Any thread.
 */
#pragma once

#include <glib.h>

enum { DEMOSAIC_RED, DEMOSAIC_GREEN, DEMOSAIC_BLUE, DEMOSAIC_COLOURS };

/* mosaic: height rows of width; values that are not finite count as black. colour: of each pixel,
 * one of the above, with the period of two of a Bayer filter. ret_ratio: of each pixel three
 * factors by which its value becomes that of red, green and blue; its own is 1. */
void demosaic_ratios(const float *mosaic, const guint8 *colour, int width, int height,
                     float *ret_ratio);
