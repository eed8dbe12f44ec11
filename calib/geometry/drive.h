/*
 * A drive that does not stand quite where it was sent: by how much it was off at each angle is a
 * parameter of an adjustment (fit.h), and from all of them follows how far it is off as a rule.
 *
 * Plain data; any thread.
 */
#pragma once

#include <glib.h>

struct drive {
    double *angles_rad; /* each that it was sent to */
    int n;
    int at;           /* parameter of the first one's error */
    double sigma_rad; /* how far it is off as a rule */
};

/* Room for most angles. */
void drive_init(struct drive *drive, int most);
void drive_clear(struct drive *drive);

/* Which angle it is; a new one is added. */
int drive_angle(struct drive *drive, double angle_rad);

/* From the errors that were found, parameters x, and how well each is known, the covariance of all
 * n parameters (one step of Dempster, Laird and Rubin's method, 1977). */
void drive_learn(struct drive *drive, const double *x, const double *covariance, int n);
#define DRIVE_ROUNDS 4 /* of adjusting and learning */
