/*
 * Peak signal-to-noise ratio of pictures. Any thread.
 *
 * All metrics of this folder take pictures as floats, height × width × 3 (R, G, B), linear sRGB,
 * row 0 at the top. 1 is white. The values of a BTF are used unchanged: 1 is a white diffuser that
 * is lit along its normal. A picture is shown before it is measured: values are clipped to 0 … 1
 * and encoded as sRGB (base/srgb.h). There is no exposure. Values must be finite.
 */
#pragma once

#include <glib.h>

/* Converts n values of R, G, B to values as shown: clips each to 0 … 1 and encodes it as sRGB. ret
 * may be the same array as linear. */
void psnr_show(const float *linear, gsize n, float *ret);

/* Returns the mean of the squared differences of two pictures as shown, over all pixels and R, G,
 * B. Means of pictures of one size may be averaged before psnr_decibels(). */
double psnr_mean_square(const float *reference, const float *test, int width, int height);

/* Returns 10 log10 (1 / mean_square), in dB. It is infinite if mean_square is 0. */
double psnr_decibels(double mean_square);

/* Returns the PSNR of two pictures in dB: psnr_decibels() of psnr_mean_square(). */
double psnr(const float *reference, const float *test, int width, int height);
