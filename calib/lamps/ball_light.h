/*
 * Light direction of a photograph from balls in it. Of the camera only its focal length may be
 * known; without it, it is taken to be far away (orthographic projection, as in reflectance
 * transformation imaging). Frame: x to the right, y up, z against the camera's line of sight.
 */
#pragma once

#include "geometry/rig.h"

struct ball_outline { /* in the picture, y down */
    double x_px, y_px, radius_px;
};

struct ball_camera {
    double focal_px;   /* 0: far away; directions are then wrong by up to a ball's radius over its
                          distance, and by the angle at which the ball is off the picture's middle */
    double x_px, y_px; /* principal point: the picture's middle; with a focal length only */
};

/* Unit direction of the light whose highlight is at a point of the ball and has the given second
 * moments: the mean direction of its light, which is further outwards than the direction at its
 * centroid. ret_from: the highlight's place on the ball, in radii of the ball, with a focal length
 * from the camera, else from the middle of the ball. ret_shift_rad: the angle from the mean to the
 * direction at the centroid, which is better where blur determines the highlight's size. FALSE: the
 * point is outside of the ball. */
gboolean ball_light_mean_direction(const struct ball_camera *camera,
                                   const struct ball_outline *ball, double x_px, double y_px,
                                   double xx_px2, double xy_px2, double yy_px2,
                                   struct vec3 *ret_from, struct vec3 *ret, double *ret_shift_rad);

/* RMS error of the direction for a highlight and an outline known with these standard deviations
 * (circle_px: of the outline's centre per axis and of its radius). */
double ball_light_sigma_rad(const struct ball_outline *ball, double circle_px, double x_px,
                            double y_px, double highlight_px);

#define BALL_LIGHT_MAX 16

struct ball_ray { /* the direction of the light at one ball, in units of the balls' (equal) radius
                   */
    struct vec3 from;      /* centre of the ball; any origin */
    struct vec3 direction; /* unit */
    double sigma_rad;      /* root mean square */
};

struct ball_light {
    struct vec3 direction; /* mean of the rays that agree */
    double sigma_rad;      /* root mean square */
    gboolean placed; /* the rays determine the position of the light, not only its direction */
    struct vec3 place, place_error; /* in radii; standard deviations */
    double miss;                    /* RMS distance of the rays from it */
    gboolean left_out[BALL_LIGHT_MAX];
    double off_rad[BALL_LIGHT_MAX]; /* angle of each ray from the result */
};

/* The light that 1 … BALL_LIGHT_MAX rays agree on: a position, or a direction if it is too far
 * away. Rays that contradict the majority are left out. FALSE: there is no majority; off_rad is
 * then the angle to the nearest other ray. */
gboolean ball_light_join(const struct ball_ray *rays, int n, struct ball_light *ret);

/* Solves a x = b for a symmetric positive definite matrix by Cramer's rule; FALSE: it is nearly
 * singular. */
gboolean ball_light_solve(const struct mat3 *a, struct vec3 b, struct vec3 *ret);
