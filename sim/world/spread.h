/*
 * Chooses the positions at which a pixel is sampled. Their density is the square area of the pixel,
 * convolved with the blur of the lens. The positions are spread evenly (stratified), and are
 * different in each pixel of each view. If a few independent random positions were used, an edge
 * would be as noisy as in a camera with a few electrons per pixel.
 *
 * Any thread may call the functions.
 */
#pragma once

#include "samples/sample.h"

#define SPREAD_STEPS 512

/* Quantiles, in px, of the horizontal profile of a pixel, convolved with the blur of the lens. */
struct spread {
    double at_px[SPREAD_STEPS + 1];
};

/* Initializes a spread. blur_px is the standard deviation of the lens's blur, above 0. */
void spread_init(struct spread *spread, double blur_px);

/* Sets ret_xy_px to across² positions: x and y of each position, relative to the pixel's centre.
 * across is at most 16. Each cell of a grid of across × across cells has one position. So has each
 * of across² columns and each of across² rows of the pixel (correlated multi-jittering; Kensler
 * 2013). */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
