/*
 * Sample positions of a pixel. They are evenly distributed over the pixel's square convolved with
 * the blur of the lens, and differ from picture to picture and from pixel to pixel. With random
 * positions, a few samples would locate an edge no better than a camera with a few electrons.
 *
 * Any thread may call the functions.
 */
#pragma once

#include "samples/sample.h"

#define SPREAD_STEPS 512

struct spread { /* point spread of a lens: quantiles of its horizontal profile, in px */
    double at_px[SPREAD_STEPS + 1];
};

/* Fills a spread. blur_px > 0 is the standard deviation of the lens's blur. */
void spread_init(struct spread *spread, double blur_px);

/* Computes across² positions, x and y of each, relative to the pixel's centre. Each cell of a grid
 * of across × across cells has one position, and so has each of across² columns and of across² rows
 * (Kensler 2013, correlated multi-jittering). */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
