/*
 * This module chooses the sample positions of a pixel. The density of the positions is the square
 * area of the pixel, convolved with the blur of the lens. The positions are evenly spread
 * (stratified). Each pixel of each view has different positions. With a few independent random
 * positions per pixel, an edge would appear as noisy as in a camera with a few electrons per pixel.
 *
 * Any thread may call the functions.
 */
#pragma once

#include "samples/sample.h"

#define SPREAD_STEPS 512

/* quantiles, in px, of the horizontal profile of a pixel that is convolved with the blur of the
 * lens */
struct spread {
    double at_px[SPREAD_STEPS + 1];
};

/* Initializes a spread. blur_px is the standard deviation of the lens's blur, above 0. */
void spread_init(struct spread *spread, double blur_px);

/* Sets ret_xy_px to across² positions: x and y of each position, relative to the pixel's centre.
 * Each cell of a grid of across × across cells has one position. Each of across² columns and each
 * of across² rows of the pixel also has one position (Kensler 2013, correlated multi-jittering).
 * across is at most 16. */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
