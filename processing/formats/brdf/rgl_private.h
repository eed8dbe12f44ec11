/* rgl.c, rgl_write.c and rgl_colour.c share the map of directions to the unit square, and
 * colours. */
#pragma once

#include "rgl.h"

#include <math.h>

static inline double rgl_u_of_theta(double theta) {
    return sqrt(MAX(theta, 0) * 2 / G_PI);
}
static inline double rgl_theta_of_u(double u) {
    return u * u * G_PI / 2;
}
/* Returns u_φ (rgl.h) from 0 up to, but not including, 1 for any φ. */
static inline double rgl_u_of_phi(double phi) {
    const double u = (phi + G_PI) / (2 * G_PI);
    return u - floor(u);
}
static inline double rgl_phi_of_u(double u) {
    return (2 * u - 1) * G_PI;
}

/* Gives the weights that convert a spectrum to linear sRGB (n × 3). Row k is the colour of a
 * spectrum that is 1 at wavelength k, 0 at the other wavelengths and linear between them. The sum
 * of all rows is the colour of a spectrum of ones, (1, 1, 1). */
void rgl_colour_weights(const float *wavelengths_nm, int n, double *ret);

/* The wavelengths of the spectra that rgl_write() writes. rgl_colour_spectra() gives the matrix,
 * RGL_WAVELENGTHS × 3, that converts (R, G, B) to such a spectrum. */
#define RGL_WAVELENGTHS 6
extern const float rgl_wavelengths_nm[RGL_WAVELENGTHS];
void rgl_colour_spectra(double ret[RGL_WAVELENGTHS][3]);
