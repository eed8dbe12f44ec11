/*
 * Characterises a sensor from pairs of single exposures, after EMVA 1288 (release 4.0 linear):
 * black level, dark current, gain, read noise and linearity. The noise of a pixel is measured by
 * the difference of two pictures of the same scene, so that the lighting need not be even; the
 * picture is divided into tiles, whose different brightness gives many points of the transfer
 * curve.
 *
 * Pure functions over arrays: any thread.
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
    double black_dn, black_error_dn; /* at exposure 0 */
    double dark_dn_s, dark_error_dn_s;
    double gain_dn_e, gain_error_dn_e;       /* EMVA 1288's K: DN per electron */
    double read_noise_e, read_noise_error_e; /* of a pixel, without quantisation */
    /* signal = linear·(1 − curvature·linear/(full scale − black)), both in DN above dark */
    double curvature, curvature_error;
    double linearity; /* largest relative deviation of an exposure's signal from a line */
    double quality;   /* χ² per degree of freedom of the transfer curve; near 1 */
    int n_points;     /* of the transfer curve */
};

#define TRANSFER_ERROR transfer_error_quark()
GQuark transfer_error_quark(void);
enum transfer_error {
    TRANSFER_ERROR_TOO_FEW, /* too few pairs or exposures */
    TRANSFER_ERROR_RANGE,   /* too dark, too bright, or all equal */
    TRANSFER_ERROR_DATA,    /* NaN, or a pair that is one picture twice */
};

/* Needs dark pairs at two exposures or more, and lit pairs at three or more, of which the
 * brightest is well above noise; saturated pixels are left out. Pairs whose pictures differ (a
 * lamp that warmed up) are refused. */
gboolean transfer_fit(const struct transfer_sensor *sensor, const struct transfer_pair *dark,
                      int n_dark, const struct transfer_pair *lit, int n_lit, struct transfer *ret,
                      GError **error);

/* Noise of a pixel that n exposures of sum_ms together are merged into, weighted by their lengths:
 * at a linear value m in DN/ms above dark at 0 dB the variance is floor + slope·max(m, 0), in
 * (DN/ms)². At other gains the read noise, in electrons, is taken to be that of 0 dB. */
void transfer_noise(const struct transfer *transfer, double sum_ms, int n, double *ret_floor,
                    double *ret_slope);
