/*
 * What a sensor does with light, from pairs of single exposures, after EMVA 1288 (release 4.0
 * linear): black level, dark current, gain, read noise and linearity. The noise of a pixel is told
 * by the difference of two pictures of the same thing, so that nothing needs to be evenly lit; the
 * picture is cut into tiles, whose different brightness gives many points of the transfer curve.
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

/* Each with its standard error. */
struct transfer {
    double black_dn, black_error_dn; /* at no exposure */
    double dark_dn_s, dark_error_dn_s;
    double gain_dn_e, gain_error_dn_e;       /* EMVA 1288's K: DN an electron */
    double read_noise_e, read_noise_error_e; /* of a pixel; quantisation taken off */
    /* signal = linear·(1 − curvature·linear/(full scale − black)), both in DN above dark */
    double curvature, curvature_error;
    double linearity; /* largest deviation of an exposure's signal from a straight line, of it */
    double quality;   /* chi-square a degree of freedom of the transfer curve; near 1 */
    int n_points;     /* of the transfer curve */
};

#define TRANSFER_ERROR transfer_error_quark()
GQuark transfer_error_quark(void);
enum transfer_error {
    TRANSFER_ERROR_TOO_FEW, /* pairs or exposures */
    TRANSFER_ERROR_RANGE,   /* too dark, too bright, or all alike */
    TRANSFER_ERROR_DATA,    /* NaN, or a pair that is one picture twice */
};

/* Needs pairs in the dark at two exposures or more, and in light at three or more, of which the
 * brightest is well above noise; what is saturated is left out. Pairs that show something else
 * than each other (a lamp that warmed up) are refused. */
gboolean transfer_fit(const struct transfer_sensor *sensor, const struct transfer_pair *dark,
                      int n_dark, const struct transfer_pair *lit, int n_lit, struct transfer *ret,
                      GError **error);
