/*
 * Finds the outline of a ball in a picture: the circle that most edges near a given one lie on.
 * The picture holds the square root of light, so that highlights do not outshine outlines.
 * Pure; any thread.
 */
#pragma once

#include "ball_light.h"
#include "pictures/picture.h"

/* Finds a circle whose centre and radius are within reach_px of the given one's; reach_px is at
 * most a quarter of the radius. FALSE: too little of such an outline is visible. ret_sigma_px:
 * standard deviation of the centre, per axis, and of the radius. */
gboolean ball_outline_find(const struct picture *picture, const struct ball_outline *given,
                           double reach_px, struct ball_outline *ret, double *ret_sigma_px);
