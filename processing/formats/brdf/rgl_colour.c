#include "rgl_private.h"

#define FIRST_NM 360
#define LAST_NM  830

/* The wavelengths of the spectra that are written are two for blue, two for green and two for
 * red. */
const float rgl_wavelengths_nm[RGL_WAVELENGTHS] = {360, 475, 505, 575, 605, 830};

/* Returns a Gaussian with different widths on the two sides of its peak (Wyman et al. 2013). */
static double lobe(double nm, double peak, double below, double above) {
    const double x = (nm - peak) / (nm < peak ? below : above);
    return exp(-0.5 * x * x);
}

/* Gives the functions x, y and z of the CIE's 1931 observer (Wyman et al. 2013 eq. 4). */
static void rgl_observer(double nm, double ret[3]) {
    ret[0] = 1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7) -
             0.065 * lobe(nm, 501.1, 20.4, 26.2);
    ret[1] = 0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1);
    ret[2] = 1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8);
}

/* Matrix from X, Y, Z to linear R, G, B (IEC 61966-2-1). It converts the white of D65 to (1, 1,
 * 1). */
static const double rgb_of_xyz[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                        {-0.9692660, 1.8760108, 0.0415560},
                                        {0.0556434, -0.2040259, 1.0572252}};
static const double white[3] = {0.95047, 1, 1.08883};

void rgl_colour_weights(const float *wavelengths_nm, int n, double *ret) {
    g_autofree double *xyz = g_new0(double, 3 * (gsize)n);
    double sums[3] = {0};
    for (int nm = FIRST_NM; nm <= LAST_NM; nm++) {
        double observer[3];
        int k = 0;
        rgl_observer(nm, observer);
        while (k + 2 < n && (double)wavelengths_nm[k + 1] <= nm)
            k++;
        const double from = (double)wavelengths_nm[k];
        const double to = n > 1 ? (double)wavelengths_nm[k + 1] : from + 1;
        if (nm < from || nm > to)
            continue; /* not measured */
        const double part = n > 1 ? (nm - from) / (to - from) : 0;
        for (int c = 0; c < 3; c++) {
            xyz[3 * k + c] += (1 - part) * observer[c];
            if (n > 1)
                xyz[3 * (k + 1) + c] += part * observer[c];
            sums[c] += observer[c];
        }
    }
    for (int k = 0; k < n; k++)
        for (int c = 0; c < 3; c++) {
            double value = 0;
            for (int j = 0; j < 3; j++)
                value += rgb_of_xyz[c][j] * white[j] *
                         (sums[j] > 0 ? xyz[3 * k + j] / sums[j] : 1.0 / n);
            ret[3 * k + c] = value;
        }
}

/* Inverts a 3 × 3 matrix by Cramer's rule. */
static void rgl_inverse(const double a[3][3], double ret[3][3]) {
    double det = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            ret[j][i] = a[(i + 1) % 3][(j + 1) % 3] * a[(i + 2) % 3][(j + 2) % 3] -
                        a[(i + 1) % 3][(j + 2) % 3] * a[(i + 2) % 3][(j + 1) % 3];
    for (int j = 0; j < 3; j++)
        det += a[0][j] * ret[j][0];
    for (int i = 0; i < 9; i++)
        ret[i / 3][i % 3] /= det;
}

void rgl_colour_spectra(double ret[RGL_WAVELENGTHS][3]) {
    double weights[RGL_WAVELENGTHS * 3], mix[3][3], inverse[3][3];
    rgl_colour_weights(rgl_wavelengths_nm, RGL_WAVELENGTHS, weights);
    /* Column b of mix is the colour of the spectrum that is 1 at the pair b of wavelengths. */
    for (int c = 0; c < 3; c++)
        for (int b = 0; b < 3; b++)
            mix[c][b] = weights[3 * (2 * b) + c] + weights[3 * (2 * b + 1) + c];
    rgl_inverse((const double(*)[3])mix, inverse);
    for (int k = 0; k < RGL_WAVELENGTHS; k++)
        for (int c = 0; c < 3; c++)
            ret[k][c] = inverse[k / 2][c];
}
