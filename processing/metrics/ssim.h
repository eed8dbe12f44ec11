/*
 * Structural similarity of pictures. Any thread.
 *
 * Pictures are as in psnr.h: height × width × 3, linear sRGB, 1 is white, finite. They are shown
 * before they are measured.
 *
 * Wang, Bovik, Sheikh & Simoncelli 2004, “Image Quality Assessment: From Error Visibility to
 * Structural Similarity”, eq. 13, with a Gaussian window of 11 × 11 pixels, σ = 1.5, K₁ = 0.01,
 * K₂ = 0.03 and L = 1.
 */
#pragma once

#define SSIM_WINDOW 11 /* side of the window in pixels */

/* Returns the mean SSIM over R, G and B and over all windows that lie within the picture (eq. 17).
 * The result is at most 1; the value 1 means that the pictures are equal. The result is NaN if the
 * width or the height is less than SSIM_WINDOW. */
double ssim(const float *reference, const float *test, int width, int height);
