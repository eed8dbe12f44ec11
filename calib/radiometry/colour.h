/*
 * From a camera's colours to CIE XYZ, by a chart whose patches are known. Pure functions; any
 * thread.
 */
#pragma once

#include <glib.h>

struct colour_patch {
    double rgb[3]; /* reflectance as the camera sees it, white balanced: 1 is a perfect white */
    double xyz[3]; /* as measured, Y = 1 for a perfect white */
};

/* What brings a white balanced R G B (1 1 1: the tile's reflectance of one) to CIE XYZ under the
 * light that the chart's values are given for. */
struct colour_matrix {
    gboolean known;
    double matrix[9], error[9]; /* rows X Y Z */
    double residual;            /* RMS of the patches' ΔE*ab */
    int patches;
};

#define COLOUR_ERROR colour_error_quark()
GQuark colour_error_quark(void);
enum colour_error {
    COLOUR_ERROR_TOO_FEW, /* patches, or they are all of one kind */
    COLOUR_ERROR_MISFIT,  /* not this chart, or not laid so */
    COLOUR_ERROR_FILE,    /* of the chart's values */
};

/* Least squares for XYZ = matrix · RGB, each patch weighted so that errors count about as they are
 * seen (CIE L*: in proportion to Y^(−2/3)). Refused where the patches lie more than 10 ΔE*ab (CIE
 * 1976; white: that of equal RGB) off on average. */
gboolean colour_fit(const struct colour_patch *patches, int n, struct colour_matrix *ret,
                    GError **error);

/* CIE 1976. */
double colour_difference(const double xyz_a[3], const double xyz_b[3], const double white[3]);
