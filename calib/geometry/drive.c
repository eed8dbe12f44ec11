#include "drive.h"

#include <math.h>

#define USUAL_RAD (0.01 * G_PI / 180) /* prior standard deviation */
#define WORTH     4 /* weight of the prior, in angles: a few angles give a poor estimate */

void drive_init(struct drive *drive, int most) {
    *drive = (struct drive){g_new(double, most + 1), 0, 0, USUAL_RAD};
}

void drive_clear(struct drive *drive) {
    g_clear_pointer(&drive->angles_rad, g_free);
}

int drive_angle(struct drive *drive, double angle_rad) {
    for (int i = 0; i < drive->n; i++)
        if (drive->angles_rad[i] == angle_rad)
            return i;
    drive->angles_rad[drive->n] = angle_rad;
    return drive->n++;
}

/* σ² = (WORTH σ₀² + Σ (x_i² + C_ii)) / (WORTH + n), C being the covariance of the errors x. */
void drive_learn(struct drive *drive, const double *x, const double *covariance, int n) {
    double sum = WORTH * USUAL_RAD * USUAL_RAD;
    for (int i = drive->at; i < drive->at + drive->n; i++)
        sum += x[i] * x[i] + covariance[i * (n + 1)];
    drive->sigma_rad = sqrt(sum / (drive->n + WORTH));
}
