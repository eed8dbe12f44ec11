/*
 * A ball's outline as pictures show it: the circle that most edges around a given one lie on.
 * Pure; any thread.
 */
#pragma once

#include "ball_light.h"
#include "pictures/picture.h"

/* The circle with its centre and radius within reach_px of the given one's, reach_px being up to a
 * quarter of the radius. FALSE: too little of such an outline is to be seen.
 * ret_sigma_px: standard deviation of the centre, each way, and of the radius. */
gboolean ball_outline_find(const struct picture *picture, const struct ball_outline *given,
                           double reach_px, struct ball_outline *ret, double *ret_sigma_px);
