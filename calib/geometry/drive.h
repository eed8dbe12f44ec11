/*
 * Angle errors of a drive: the error at each commanded angle is a parameter of an adjustment
 * (fit.h), and their standard deviation is estimated from all of them.
 *
 * Plain data; any thread.
 */
#pragma once

#include <glib.h>

struct drive {
    double *angles_rad; /* n commanded angles */
    int n;
    int at;           /* index of the first one's error among the parameters */
    double sigma_rad; /* standard deviation of the errors */
};

/* Allocates for at most `most` angles. */
void drive_init(struct drive *drive, int most);
void drive_clear(struct drive *drive);

/* Index of an angle; a new one is added. */
int drive_angle(struct drive *drive, double angle_rad);

/* Updates sigma_rad from the fitted errors in the parameters x and the covariance of all n
 * parameters (one EM step, Dempster, Laird and Rubin 1977). */
void drive_learn(struct drive *drive, const double *x, const double *covariance, int n);
#define DRIVE_ROUNDS 4 /* rounds of adjustment and update */
