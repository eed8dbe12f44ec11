/*
 * Where the light of a photograph comes from, by balls in it, when nothing is known of the camera
 * but that it is far away: seen along parallel lines (as in reflectance transformation imaging).
 * Frame: x to the right, y up, z to the camera; pixels, or mm if the balls' radius is in mm.
 */
#pragma once

#include "rig.h"

struct ball_outline { /* in the picture, y down */
    double x_px, y_px, radius_px;
};

/* The direction, unit, of the light whose highlight is at a point of the ball; FALSE: outside. */
gboolean ball_light_direction(const struct ball_outline *ball, double x_px, double y_px,
                              struct vec3 *ret);

/* Where the rays from n ≥ 2 balls' highlights meet, in units of the balls' (equal) radius, from the
 * first ball's centre. highlights: x, y of each. FALSE: they are as good as parallel.
 * ret_miss: root mean square of how far the rays pass from there. */
gboolean ball_light_place(const struct ball_outline *balls, const double (*highlights_px)[2], int n,
                          struct vec3 *ret, double *ret_miss);
