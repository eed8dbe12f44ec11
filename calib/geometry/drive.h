/*
 * A drive has an angle error at each commanded angle. Each error is a parameter of an adjustment
 * (fit.h), and the standard deviation of the errors is estimated from all errors of the drive.
 *
 * Any thread may call the functions.
 */
#pragma once

#include "fit.h"

struct drive {
    double *angles_rad; /* n commanded angles */
    int n;
    int at;           /* parameter index of the error of the first angle */
    double sigma_rad; /* standard deviation of the errors */
};

/* Allocates memory for at most `most` angles. */
void drive_init(struct drive *drive, int most);
void drive_clear(struct drive *drive);

/* Returns the index of an angle. Adds the angle if it is new. */
int drive_angle(struct drive *drive, double angle_rad);

/* Alternates between fit_solve() and the estimate of the drives' sigma_rad from the result of
 * fit_solve() (EM, Dempster, Laird and Rubin 1977).
 *
 * Each parameter has a prior with the mean 0. `sigma` has the standard deviations of these priors.
 * The priors that `fit` has are not used. The function writes the estimated sigma_rad
 * into the drives, and into the elements of `sigma` that belong to the drives. x has the
 * parameters, like `parameters` of fit_solve(). ret and the return value are as for fit_solve(). */
gboolean drive_fit(const struct fit *fit, double *sigma, struct drive *const *drives, int n_drives,
                   double *x, struct fit_result *ret);
