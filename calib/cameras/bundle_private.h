/* The C and C++ files of the bundle adjustment share these declarations. */
#pragma once

#include "bundle.h"

G_BEGIN_DECLS

/* Derivatives of the picture's x, y (rows) with respect to the intrinsics of a lens, a camera's
 * pose (ω, shift), a lay (ω, t_x, t_y, h), the turntable's angle, the board's bend, and the
 * wobble. */
struct bundle_slopes {
    double lens[2][BUNDLE_INTRINSICS], pose[2][6], lay[2][6], angle[2], bend[2][3];
    double wobble[2][BUNDLE_WOBBLE];
};

/* Parameters at which bundle_image() projects, as in bundle_slopes. ω of pose and lay is relative
 * to the rotation R₀ of the camera and of the lay. */
struct bundle_parameters {
    const double *lens, *pose, *lay;
    double angle;
    const double *bend;   /* NULL for a flat board */
    const double *wobble; /* NULL for no wobble */
    double commanded;     /* commanded angle of the turntable, for the wobble */
};
/* bundle_project.c: projects a board point to the picture. ret gets the derivatives, and may be
 * NULL. Returns FALSE if the point is behind the camera (for a fisheye, straight behind it), or
 * beyond the range of a rational lens. */
gboolean bundle_image(const struct bundle_camera *camera, const struct bundle_lay *lay,
                      const struct bundle_parameters *at, const double board_mm[2],
                      double ret_px[2], struct bundle_slopes *ret);

/* Computes a camera's centre −(R₀ exp([ω]×))ᵀ shift, and its derivatives (rows x, y, z) with
 * respect to pose = (ω, shift). */
void bundle_centre(const struct bundle_camera *camera, const double pose[6], double ret_mm[3],
                   double ret_slopes[3][6]);

/* Replaces R₀ by R₀ exp([ω]×), corrected for rounding errors. */
void bundle_turn(double rotation[9], const double omega[3]);

/* Returns whether a lens model has parameter i of its intrinsics. */
gboolean bundle_has(enum rig_lens lens, int i);

/* The Jacobian of the problem at its solution, in compressed rows: two rows for each observation
 * that is not rejected, then the rows of the priors. `lens` and `pose` have, for each camera, the
 * first column of its free parameters, or −1 if these parameters are fixed. The stops of one camera
 * have the same lens. */
struct bundle_linear {
    int n_rows, n_columns;
    /* row i has the elements rows[i] … rows[i + 1] − 1 of columns and values */
    const int *rows, *columns;
    const double *values, *residuals;
    const int *lens, *pose;
    /* wobble: first column of the wobble, or −1 if the wobble is fixed. n_wobble: number of columns
     * of the wobble. */
    int wobble, n_wobble;
};

/* bundle_covariance.c: does the work of bundle_covariance() (bundle.h) with the matrix. */
gboolean bundle_scatter(struct bundle *bundle, const struct bundle_linear *linear,
                        double *ret_inflation, GError **error);

G_END_DECLS
