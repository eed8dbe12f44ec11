/* Declarations shared by the sources of the bundle adjustment, in C and C++. */
#pragma once

#include "bundle.h"

G_BEGIN_DECLS

/* Derivatives of the picture's x, y (rows) by the parameters of a lens, of a camera's pose (ω,
 * shift), of a lay (ω, t_x, t_y, h), by the turntable's angle, by the board's bend, and by the
 * wobble. */
struct bundle_slopes {
    double lens[2][BUNDLE_INTRINSICS], pose[2][6], lay[2][6], angle[2], bend[2][3];
    double wobble[2][BUNDLE_WOBBLE];
};

/* bundle_project.c: a board point in the picture, from parameters and the rotations R₀ (row by row)
 * that their ω belong to. ret: may be NULL. FALSE: behind the camera. */
struct bundle_parameters {
    const double *lens, *pose, *lay;
    double angle;
    const double *bend;   /* NULL: the board is flat */
    const double *wobble; /* NULL: none */
    double commanded;     /* angle of the turntable that the wobble belongs to */
};
gboolean bundle_image(const struct bundle_camera *camera, const struct bundle_lay *lay,
                      const struct bundle_parameters *at, const double board_mm[2],
                      double ret_px[2], struct bundle_slopes *ret);

/* A camera's centre −(R₀ exp([ω]×))ᵀ shift, and its derivatives (rows: of x, y, z) by pose = (ω,
 * shift). */
void bundle_centre(const struct bundle_camera *camera, const double pose[6], double ret_mm[3],
                   double ret_slopes[3][6]);

/* R₀ ← R₀ exp([ω]×), and to the nearest rotation. */
void bundle_turn(double rotation[9], const double omega[3]);

/* Whether a lens model has parameter i of its intrinsics. */
gboolean bundle_has(enum rig_lens lens, int i);

/* The problem at its solution, in compressed rows: two for each observation that is not rejected,
 * then those of priors. lens, pose: first column of each camera's free parameters; −1: fixed. Stops
 * of one camera have the same lens. */
struct bundle_linear {
    int n_rows, n_columns;
    const int *rows, *columns;
    const double *values, *residuals;
    const int *lens, *pose;
    int wobble, n_wobble; /* first column, −1: fixed; and number of columns */
};

/* bundle_covariance.c: sets the cameras' covariances. */
gboolean bundle_scatter(struct bundle *bundle, const struct bundle_linear *linear,
                        double *ret_inflation, GError **error);

G_END_DECLS
