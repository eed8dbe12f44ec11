/*
 * FLIP is the difference that a person sees who alternates between two pictures. Any thread.
 *
 * Pictures are as in psnr.h: height × width × 3, linear sRGB, 1 is white, finite.
 *
 * The method is that of Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström & Fairchild 2020,
 * “FLIP: A Difference Evaluator for Alternating Images”. flip_hdr() is that of Andersson, Nilsson,
 * Shirley & Akenine-Möller 2021, “Visualizing Errors in Rendered High Dynamic Range Images”.
 */
#pragma once

#include <glib.h>

/* Pixels of the display per degree of the field of view. The value is that of the paper, 67.02: a
 * display that has 3840 pixels over a width of 0.7 m is seen from 0.7 m. */
#define FLIP_PIXELS_PER_DEGREE (0.7 * 3840 / 0.7 * G_PI / 180)

/* Returns the mean FLIP of two pictures, from 0 (equal) to 1. Values are clipped to 0 … 1. ret_map
 * gets the FLIP of each pixel (height × width); it may be NULL. */
double flip_ldr(const float *reference, const float *test, int width, int height,
                double pixels_per_degree, float *ret_map);

/* Returns the mean FLIP of two pictures with values above 1. Both pictures are exposed with each of
 * a range of exposures, which follows from the reference, and mapped with the tone curve of ACES.
 * The FLIP of a pixel is the maximum over the exposures. Negative values count as 0. ret_map is as
 * in flip_ldr(). */
double flip_hdr(const float *reference, const float *test, int width, int height,
                double pixels_per_degree, float *ret_map);
