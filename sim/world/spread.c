#include "spread.h"

#include <math.h>

#define REACH      4.5 /* there is no light beyond this number of standard deviations of the blur */
#define MAX_ACROSS 16

/* Returns the integral, from −∞ to x, of the distribution function of a Gaussian with standard
 * deviation blur. */
static double ramp(double x, double blur) {
    const double z = x / blur;
    return x * 0.5 * (1 + erf(z * M_SQRT1_2)) + blur * exp(-z * z / 2) / sqrt(2 * G_PI);
}

void spread_init(struct spread *spread, double blur_px) {
    const double reach = 0.5 + REACH * blur_px;
    for (int i = 0; i <= SPREAD_STEPS; i++) {
        double low = -reach, high = reach;
        for (int k = 0; k < 40; k++) {
            const double middle = (low + high) / 2;
            /* The difference is the part of a pixel's light that comes from the left of the
             * position `middle`. */
            if (ramp(middle + 0.5, blur_px) - ramp(middle - 0.5, blur_px) <
                (double)i / SPREAD_STEPS)
                low = middle;
            else
                high = middle;
        }
        spread->at_px[i] = (low + high) / 2;
    }
}

static double place(const struct spread *spread, double part) {
    const double step = part * SPREAD_STEPS;
    const int i = MIN((int)step, SPREAD_STEPS - 1);
    return spread->at_px[i] + (step - i) * (spread->at_px[i + 1] - spread->at_px[i]);
}

static void shuffle(struct sample_random *random, int n, int *ret) {
    for (int i = 0; i < n; i++) {
        const int k = (int)(sample_uniform(random) * (i + 1));
        ret[i] = ret[k];
        ret[k] = i;
    }
}

void spread_pixel(const struct spread *spread, struct sample_random *random, int across,
                  double *ret_xy_px) {
    int columns[MAX_ACROSS][MAX_ACROSS], rows[MAX_ACROSS][MAX_ACROSS];
    const int n = MIN(across, MAX_ACROSS);
    for (int i = 0; i < n; i++) {
        shuffle(random, n, columns[i]);
        shuffle(random, n, rows[i]);
    }
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            double *to = ret_xy_px + 2 * (j * across + i);
            to[0] = place(spread, (i + (columns[i][j] + sample_uniform(random)) / n) / n);
            to[1] = place(spread, (j + (rows[j][i] + sample_uniform(random)) / n) / n);
        }
}
