/*
 * This module finds the conversion of a camera's colours to CIE XYZ from a chart with known
 * patches. The functions are pure, and any thread may call them.
 */
#pragma once

#include <glib.h>

struct colour_patch {
    double rgb[3]; /* white-balanced reflectance as seen by the camera; 1 for a perfect white */
    double xyz[3]; /* the chart's values; Y = 1 for a perfect white */
};

/* Maps white-balanced R G B to CIE XYZ under the illuminant of the chart's values. R G B = 1 1 1 is
 * a reflectance of 1. */
struct colour_matrix {
    gboolean known;
    /* The rows of `matrix` give X, Y and Z. `error` has the standard errors of the elements. */
    double matrix[9], error[9];
    double residual; /* RMS of the patches' ΔE*ab */
    int patches;
};

#define COLOUR_ERROR colour_error_quark()
GQuark colour_error_quark(void);
enum colour_error {
    COLOUR_ERROR_TOO_FEW, /* there are too few patches, or all have similar colours */
    /* A value is not a number. Or the measured colours differ from the chart's values, because the
     * chart is another one or lies in another orientation. */
    COLOUR_ERROR_MISFIT,
    COLOUR_ERROR_FILE, /* the file of the chart's values has a mistake */
};

/* Fits XYZ = matrix · RGB by least squares. Each patch is weighted for a uniform error in L* (dL* ∝
 * Y^(−2/3) dY). Returns FALSE with an error in these cases:
 * - a value is not finite,
 * - there are fewer than 6 patches,
 * - the patches do not determine the matrix,
 * - the matrix does not map equal RGB to positive XYZ,
 * - the RMS of the patches' differences is 10 ΔE*ab (CIE 1976) or more.
 *
 * The white of ΔE*ab has the chromaticity of equal RGB and Y = 1, so that the scale of RGB does not
 * change ΔE. */
gboolean colour_fit(const struct colour_patch *patches, int n, struct colour_matrix *ret,
                    GError **error);

/* Returns the difference ΔE*ab (CIE 1976) of two colours, relative to a white. */
double colour_difference(const double xyz_a[3], const double xyz_b[3], const double white[3]);
