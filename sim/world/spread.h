/*
 * Sample positions of a pixel. They are distributed evenly over the pixel's square convolved with
 * the blur of the lens, and differ in every picture and pixel. With random positions, a few samples
 * would locate an edge no better than a camera of a few electrons.
 *
 * Any thread.
 */
#pragma once

#include "samples/sample.h"

#define SPREAD_STEPS 512

struct spread { /* point spread of a lens: quantiles of its horizontal profile in pixels */
    double at_px[SPREAD_STEPS + 1];
};

/* blur_px is the standard deviation of the lens's blur, above 0. */
void spread_init(struct spread *spread, double blur_px);

/* Gives across² positions, x and y of each, relative to the pixel's centre. Each cell of a grid of
 * across × across has one position, and so has each of across² columns and rows (Kensler 2013,
 * correlated multi-jittering). */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
