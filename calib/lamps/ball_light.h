/*
 * Where the light of a photograph comes from, by balls in it, when nothing is known of the camera
 * but that it is far away: seen along parallel lines (as in reflectance transformation imaging).
 * Frame: x to the right, y up, z to the camera; pixels, or mm if the balls' radius is in mm.
 */
#pragma once

#include "geometry/rig.h"

struct ball_outline { /* in the picture, y down */
    double x_px, y_px, radius_px;
};

/* The direction, unit, of the light whose highlight is at a point of the ball; FALSE: outside. */
gboolean ball_light_direction(const struct ball_outline *ball, double x_px, double y_px,
                              struct vec3 *ret);

/* The same of a highlight that extends, by second moments: the mean of its light's directions,
 * which lies further outwards than the direction of its middle. */
gboolean ball_light_mean_direction(const struct ball_outline *ball, double x_px, double y_px,
                                   double xx_px2, double xy_px2, double yy_px2, struct vec3 *ret);

/* How far the direction may be off, root mean square: of a highlight and an outline known with
 * these standard deviations (of a centre each way and of the radius). */
double ball_light_sigma_rad(const struct ball_outline *ball, double circle_px, double x_px,
                            double y_px, double highlight_px);

#define BALL_LIGHT_MOST 16

struct ball_ray {          /* where a ball shows the light, in units of the balls' (equal) radius */
    struct vec3 from;      /* on the ball; any origin */
    struct vec3 direction; /* unit */
    double sigma_rad;      /* root mean square */
};

struct ball_light {
    struct vec3 direction;          /* mean of the rays that agree */
    double sigma_rad;               /* root mean square */
    gboolean placed;                /* the rays tell where the light is, not only its direction */
    struct vec3 place, place_error; /* radii; standard deviations */
    double miss;                    /* root mean square of how far the rays pass from there */
    gboolean left_out[BALL_LIGHT_MOST];
    double off_rad[BALL_LIGHT_MOST]; /* each ray from what the others say */
};

/* What light 1 … BALL_LIGHT_MOST rays agree on: a place, or a direction if it is too far away. Rays
 * that contradict the majority are left out. FALSE: there is no majority; off_rad is from the
 * nearest other ray. */
gboolean ball_light_join(const struct ball_ray *rays, int n, struct ball_light *ret);

/* Cramer's rule for a symmetric positive matrix; FALSE: it is nearly singular. */
gboolean ball_light_solve(const struct mat3 *a, struct vec3 b, struct vec3 *ret);
