/*
 * This module computes the direction of the light in a photograph from balls in the photograph. If
 * the focal length of the camera is not known, the camera is assumed to be far away (orthographic
 * projection, as in reflectance transformation imaging). In the frame of the directions, x is to
 * the right, y up, and z towards the camera.
 */
#pragma once

#include "geometry/rig.h"

struct ball_outline { /* in the picture, y down */
    double x_px, y_px, radius_px;
};

struct ball_camera {
    /* Focal length in px. If it is not known, it is 0, and the camera is assumed to be far away.
     * Directions then have errors of up to a ball's radius over its distance, plus the angle
     * between the ball and the middle of the picture. */
    double focal_px;
    double x_px, y_px; /* principal point: the picture's middle; used only with a focal length */
};

/* Computes the unit direction *ret of the light whose highlight is at a point of the ball and has
 * the given second moments. This is the mean direction of the light in the highlight. If the
 * highlight reaches beyond the ball, *ret is instead the direction at the highlight's centroid.
 *
 * *ret_shift_rad is the angle between the mean direction and the direction at the centroid. The
 * mean direction is the one further outwards. If the highlight is mainly blur, the direction at the
 * centroid is more accurate.
 *
 * *ret_from is the place of the highlight on its ball, in radii of the ball. With a focal length,
 * this place is relative to the camera. Without a focal length, it is relative to the middle of the
 * ball.
 *
 * Returns FALSE if the point is outside the ball, or if the ball's outline is too large for the
 * focal length. */
gboolean ball_light_mean_direction(const struct ball_camera *camera,
                                   const struct ball_outline *ball, double x_px, double y_px,
                                   double xx_px2, double xy_px2, double yy_px2,
                                   struct vec3 *ret_from, struct vec3 *ret, double *ret_shift_rad);

/* Computes a point of the plate on which the ball lies, from the place x_px, y_px of this point in
 * the picture. The camera must look at right angles onto the plate. *ret is in radii of the ball.
 * With a focal length, *ret is relative to the camera, otherwise to the middle of the ball. Returns
 * FALSE if the ball's outline is too large for the focal length. */
gboolean ball_light_plate(const struct ball_camera *camera, const struct ball_outline *ball,
                          double x_px, double y_px, struct vec3 *ret);

/* Computes the point at which a ray meets the sphere with the given radius around `middle`. The ray
 * begins at `from`, inside the sphere, and has the unit vector `direction`. If the lamps stand on
 * the sphere, the point is the position of the lamp. Returns FALSE if `from` is not inside the
 * sphere. */
gboolean ball_light_on_sphere(struct vec3 from, struct vec3 direction, struct vec3 middle,
                              double radius, struct vec3 *ret);

/* Returns the RMS error of the direction in radians. highlight_px is the standard deviation of the
 * highlight's position. circle_px is the standard deviation of the outline's centre, per axis, and
 * of its radius. */
double ball_light_sigma_rad(const struct ball_outline *ball, double circle_px, double x_px,
                            double y_px, double highlight_px);

#define BALL_LIGHT_MAX 16

/* The direction of the light at one ball. Lengths are in radii of the balls, which are equal. */
struct ball_ray {
    struct vec3 from;      /* place of the highlight on its ball, relative to any origin */
    struct vec3 direction; /* unit */
    double sigma_rad;      /* RMS error of the direction */
};

struct ball_light {
    struct vec3 direction; /* unit vector: mean direction of the rays that agree */
    double sigma_rad;      /* RMS error of the direction */
    gboolean placed; /* the rays determine the position of the light, not only its direction */
    /* If placed: the position of the light, in radii. place_error has the standard deviation of
     * each coordinate. */
    struct vec3 place, place_error;
    double miss;                       /* if placed: RMS distance of the rays from `place`, radii */
    gboolean left_out[BALL_LIGHT_MAX]; /* the ray contradicts the majority */
    /* angle between each ray and the direction that the result predicts for its ball */
    double off_rad[BALL_LIGHT_MAX];
};

/* Finds the light that 1 … BALL_LIGHT_MAX rays agree on: a position, or a direction if the light is
 * too far away. Rays that contradict the majority are left out. Returns FALSE if no set of more
 * than half of the rays agrees, or if the largest such set is not unique. off_rad then has the
 * angle between each ray and the other ray whose direction is nearest. */
gboolean ball_light_join(const struct ball_ray *rays, int n, struct ball_light *ret);

/* Solves a x = b for a symmetric positive definite matrix by Cramer's rule. Returns FALSE if a is
 * nearly singular. */
gboolean ball_light_solve(const struct mat3 *a, struct vec3 b, struct vec3 *ret);
