/* Declarations shared by the sources of the bundle adjustment, in C and C++. */
#pragma once

#include "bundle.h"

G_BEGIN_DECLS

/* Derivatives of the picture's x, y (rows) with respect to the parameters of a lens, of a camera's
 * pose (ω, shift), of a lay (ω, t_x, t_y, h), the turntable's angle, the board's bend, and the
 * wobble. */
struct bundle_slopes {
    double lens[2][BUNDLE_INTRINSICS], pose[2][6], lay[2][6], angle[2], bend[2][3];
    double wobble[2][BUNDLE_WOBBLE];
};

/* bundle_project.c: projects a board point to the picture. ω is relative to the rotations R₀ (row
 * by row) of camera and lay. ret may be NULL. Returns FALSE if the point is behind the camera. */
struct bundle_parameters {
    const double *lens, *pose, *lay;
    double angle;
    const double *bend;   /* NULL for a flat board */
    const double *wobble; /* NULL for no wobble */
    double commanded;     /* commanded angle of the turntable, for the wobble */
};
gboolean bundle_image(const struct bundle_camera *camera, const struct bundle_lay *lay,
                      const struct bundle_parameters *at, const double board_mm[2],
                      double ret_px[2], struct bundle_slopes *ret);

/* Computes a camera's centre −(R₀ exp([ω]×))ᵀ shift, and its derivatives (rows x, y, z) with
 * respect to pose = (ω, shift). */
void bundle_centre(const struct bundle_camera *camera, const double pose[6], double ret_mm[3],
                   double ret_slopes[3][6]);

/* Replaces R₀ by R₀ exp([ω]×), corrected for rounding errors. */
void bundle_turn(double rotation[9], const double omega[3]);

/* Whether a lens model has parameter i of its intrinsics. */
gboolean bundle_has(enum rig_lens lens, int i);

/* The problem at its solution, as a matrix in compressed rows: two rows for each observation that
 * is not rejected, then the rows of the priors. lens and pose have the first column of each
 * camera's free parameters, or −1 if they are fixed. The stops of one camera have the same lens. */
struct bundle_linear {
    int n_rows, n_columns;
    const int *rows, *columns;
    const double *values, *residuals;
    const int *lens, *pose;
    int wobble, n_wobble; /* first column, or −1 if fixed; number of columns */
};

/* bundle_covariance.c: sets the cameras' covariances. */
gboolean bundle_scatter(struct bundle *bundle, const struct bundle_linear *linear,
                        double *ret_inflation, GError **error);

G_END_DECLS
