/* Shared by rgl.c, rgl_write.c and rgl_colour.c. */
#pragma once

#include "rgl.h"

#include <math.h>

static inline double rgl_u_of_theta(double theta) {
    return sqrt(MAX(theta, 0) * 2 / G_PI);
}
static inline double rgl_theta_of_u(double u) {
    return u * u * G_PI / 2;
}
/* 0 … 1 for any φ. */
static inline double rgl_u_of_phi(double phi) {
    const double u = (phi + G_PI) / (2 * G_PI);
    return u - floor(u);
}
static inline double rgl_phi_of_u(double u) {
    return (2 * u - 1) * G_PI;
}

/* Linear sRGB of a spectrum that is ret[k] at one of the wavelengths k and linear between them.
 * ret: n × 3, its rows sum to the colour of a spectrum of ones, (1, 1, 1). */
void rgl_colour_weights(const float *wavelengths_nm, int n, double *ret);

/* The wavelengths at which rgl_write() states a spectrum, and the spectrum of each colour: ret
 * RGL_WAVELENGTHS × 3, to be multiplied by (R, G, B). */
#define RGL_WAVELENGTHS 6
extern const float rgl_wavelengths_nm[RGL_WAVELENGTHS];
void rgl_colour_spectra(double ret[RGL_WAVELENGTHS][3]);
