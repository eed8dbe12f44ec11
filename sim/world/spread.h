/*
 * Where the samples of a pixel look: all over the pixel's square and what the lens blurs into it,
 * evenly, and elsewhere in every picture and of every pixel. Strewn at random, a few samples would
 * say no better where an edge is than a camera of a few electrons.
 *
 * Any thread.
 */
#pragma once

#include "sample.h"

#define SPREAD_STEPS 512

struct spread { /* of a lens: where so much of the light comes from further left, in px */
    double at_px[SPREAD_STEPS + 1];
};

/* blur_px > 0: standard deviation of the lens's blur. */
void spread_init(struct spread *spread, double blur_px);

/* across² places, x and y of each, from the pixel's centre: one in each cell of a grid of across ×
 * across, one in each of across² columns and rows (Kensler 2013, correlated multi-jittering). */
void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px);
