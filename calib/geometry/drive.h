/*
 * Angle errors of a drive: the error at each commanded angle is a parameter of an adjustment
 * (fit.h), and their standard deviation is estimated from all of them.
 *
 * Plain data; any thread.
 */
#pragma once

#include "fit.h"

struct drive {
    double *angles_rad; /* n commanded angles */
    int n;
    int at;           /* parameter index of the error of the first angle */
    double sigma_rad; /* standard deviation of the errors */
};

/* Allocates for at most `most` angles. */
void drive_init(struct drive *drive, int most);
void drive_clear(struct drive *drive);

/* Returns the index of an angle, which it adds if it is new. */
int drive_angle(struct drive *drive, double angle_rad);

/* Alternates between fit_solve() and the estimate of the drives' sigma_rad from its result (EM,
 * Dempster, Laird and Rubin 1977). Priors have the mean 0 and the standard deviations sigma
 * (n_parameters); the function writes those of the drives into sigma. Returns and errors as
 * fit_solve(). */
gboolean drive_fit(const struct fit *fit, double *sigma, struct drive *const *drives, int n_drives,
                   double *x, struct fit_result *ret);
