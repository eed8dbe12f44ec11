/*
 * Colour calibration: the conversion of a camera's colours to CIE XYZ, from a chart with known
 * patches. Pure functions; any thread.
 */
#pragma once

#include <glib.h>

struct colour_patch {
    double rgb[3]; /* white balanced reflectance as seen by the camera: 1 is a perfect white */
    double xyz[3]; /* as measured, Y = 1 for a perfect white */
};

/* Maps white balanced R G B (1 1 1: the tile's reflectance of one) to CIE XYZ under the
 * illuminant of the chart's values. */
struct colour_matrix {
    gboolean known;
    double matrix[9], error[9]; /* rows X Y Z */
    double residual;            /* RMS of the patches' ΔE*ab */
    int patches;
};

#define COLOUR_ERROR colour_error_quark()
GQuark colour_error_quark(void);
enum colour_error {
    COLOUR_ERROR_TOO_FEW, /* too few patches, or all of similar colours */
    COLOUR_ERROR_MISFIT,  /* another chart, or in another orientation */
    COLOUR_ERROR_FILE,    /* the file of the chart's values */
};

/* Least squares for XYZ = matrix · RGB with each patch weighted for a uniform error in L* (dL* ∝
 * Y^(−2/3) dY). Refused if the patches differ by more than 10 ΔE*ab (CIE 1976) on average. White
 * has the chromaticity of equal RGB and Y = 1, so that the scale of RGB does not change ΔE. */
gboolean colour_fit(const struct colour_patch *patches, int n, struct colour_matrix *ret,
                    GError **error);

/* ΔE*ab, CIE 1976. */
double colour_difference(const double xyz_a[3], const double xyz_b[3], const double white[3]);
