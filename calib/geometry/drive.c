#include "drive.h"

#include <math.h>

#define USUAL_RAD (0.01 * G_PI / 180) /* prior standard deviation of an angle error */
/* Number of estimates of the drives' standard deviations. A fit precedes the first and follows
 * each. */
#define ROUNDS 4
#define WORTH  4 /* weight of USUAL_RAD in an estimate, as a number of angle errors */

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

gboolean drive_fit(const struct fit *fit, double *sigma, struct drive *const *drives, int n_drives,
                   double *x, struct fit_result *ret) {
    g_autofree double *none = g_new0(double, fit->n_parameters);
    struct fit with = *fit;
    with.known = none;
    with.known_sigma = sigma;
    for (int round = 0;; round++) {
        for (int k = 0; k < n_drives; k++)
            for (int i = 0; i < drives[k]->n; i++)
                sigma[drives[k]->at + i] = drives[k]->sigma_rad;
        if (!fit_solve(&with, x, ret))
            return FALSE;
        with.is_near = TRUE;
        if (round == ROUNDS)
            return TRUE;
        /* σ² = (WORTH σ₀² + Σ (x_i² + C_ii)) / (WORTH + n), where x_i are the n angle errors of the
         * drive and C is their covariance. */
        for (int k = 0; k < n_drives; k++) {
            double sum = WORTH * USUAL_RAD * USUAL_RAD;
            for (int i = drives[k]->at; i < drives[k]->at + drives[k]->n; i++)
                sum += x[i] * x[i] + ret->covariance[i * (fit->n_parameters + 1)];
            drives[k]->sigma_rad = sqrt(sum / (drives[k]->n + WORTH));
        }
        fit_result_clear(ret);
    }
}
