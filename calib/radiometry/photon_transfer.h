/*
 * This module finds black level, dark current, gain, read noise and linearity of a sensor from
 * pairs of single exposures, after EMVA 1288 (release 4.0 linear). The noise of a pixel is measured
 * by the difference of two pictures of the same scene, so the lighting need not be even.
 *
 * The picture is divided into tiles. Tiles of different brightness give many points of the transfer
 * curve, which is the noise variance as a function of the signal.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include <glib.h>

struct transfer_pair {
    double exposure_us;
    const float *first, *second; /* height × width raw DN, nothing subtracted */
};

struct transfer_sensor {
    int width, height, bits;
};

/* Results with their standard errors. */
struct transfer {
    double black_dn, black_error_dn; /* dark level at exposure 0 */
    double dark_dn_s, dark_error_dn_s;
    double gain_dn_e, gain_error_dn_e;       /* EMVA 1288's K: DN per electron */
    double read_noise_e, read_noise_error_e; /* read noise of a pixel, without quantisation */
    /* signal = linear·(1 − curvature·linear/(full scale − black)), both in DN above dark */
    double curvature, curvature_error;
    /* largest relative deviation of an exposure's mean signal from a line through 0 */
    double linearity;
    double quality; /* χ² per degree of freedom of the transfer curve; should be near 1 */
    int n_points;   /* number of points of the transfer curve */
};

#define TRANSFER_ERROR transfer_error_quark()
GQuark transfer_error_quark(void);
enum transfer_error {
    TRANSFER_ERROR_TOO_FEW, /* there are too few pairs or exposures */
    TRANSFER_ERROR_RANGE,   /* the pictures are too dark, too bright, or all equal */
    /* A pixel is not finite. Or the two pictures of a pair are identical, or differ in
     * brightness. */
    TRANSFER_ERROR_DATA,
};

/* Computes the result from dark pairs at two or more exposures and lit pairs at three or more
 * exposures. At least one tile must be lit to between 15 % and 70 % of full scale. Saturated tiles
 * are left out.
 *
 * Returns FALSE with an error if the pictures do not suffice, or if the two pictures of a pair
 * differ in brightness, for example because a lamp was warming up. */
gboolean transfer_fit(const struct transfer_sensor *sensor, const struct transfer_pair *dark,
                      int n_dark, const struct transfer_pair *lit, int n_lit, struct transfer *ret,
                      GError **error);

/* Computes the noise of a pixel that is merged from n exposures, weighted by their lengths. sum_ms
 * is the sum of the lengths. A pixel with the linear value m in DN/ms above dark, at 0 dB, has the
 * variance floor + slope·max(m, 0), in (DN/ms)². The read noise in electrons is assumed to be the
 * same at all gains. */
void transfer_noise(const struct transfer *transfer, double sum_ms, int n, double *ret_floor,
                    double *ret_slope);
