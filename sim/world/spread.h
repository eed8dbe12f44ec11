/*
 * Sample positions of a pixel: evenly distributed over the pixel's square convolved with the blur
 * of the lens, and different in every picture and pixel. With random positions, a few samples would
 * locate an edge no better than a camera of a few electrons.
 *
 * Any thread.
 */
#pragma once

#include "samples/sample.h"

#define SPREAD_STEPS 512

struct spread { /* point spread of a lens: quantiles of its horizontal profile, px */
    double at_px[SPREAD_STEPS + 1];
};

/* blur_px > 0: standard deviation of the lens's blur. */
void spread_init(struct spread *spread, double blur_px);

/* across² positions, x and y of each, from the pixel's centre: one in each cell of a grid of across
 * × across, one in each of across² columns and rows (Kensler 2013, correlated multi-jittering). */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
