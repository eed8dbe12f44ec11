/* Fits XYZ = M · RGB by weighted least squares. A row m of M follows from the patches' colours rgb,
 * the element xyz of their CIE XYZ that belongs to this row, and the weights w = Y^(−4/3):
 *   m = (Σ w rgb rgbᵀ)⁻¹ Σ w rgb·xyz. */
#include "colour.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#define FEW_PATCHES 6
#define MAX_OFF     10.0 /* smallest RMS difference ΔE*ab at which a fit is refused */
#define DARK        0.01 /* Y below which all patches have the same weight */
/* Smallest pivot of Σ w·rgb·rgbᵀ relative to its trace. If a pivot is smaller, the patches do not
 * span all colours. */
#define MIN_PIVOT 1e-6

G_DEFINE_QUARK(colour_error, colour_error)

static void to_lab(const double xyz[3], const double white[3], double ret[3]) {
    double f[3]; /* f(t) of CIE L*a*b* (CIE 15) */
    for (int i = 0; i < 3; i++) {
        double t = xyz[i] / white[i];
        f[i] = t > 216.0 / 24389 ? cbrt(t) : (24389.0 / 27 * t + 16) / 116;
    }
    ret[0] = 116 * f[1] - 16;
    ret[1] = 500 * (f[0] - f[1]);
    ret[2] = 200 * (f[1] - f[2]);
}

double colour_difference(const double xyz_a[3], const double xyz_b[3], const double white[3]) {
    double a[3], b[3], sum = 0;
    to_lab(xyz_a, white, a);
    to_lab(xyz_b, white, b);
    for (int i = 0; i < 3; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum);
}

static void colour_apply(const double matrix[9], const double rgb[3], double ret[3]) {
    for (int i = 0; i < 3; i++)
        ret[i] = matrix[3 * i] * rgb[0] + matrix[3 * i + 1] * rgb[1] + matrix[3 * i + 2] * rgb[2];
}

/* Returns the weight of a patch. The derivative of CIE L* with respect to Y is proportional to
 * Y^(−2/3), and the weight is the square of this derivative. */
static double colour_weight_of(const struct colour_patch *patch) {
    return pow(MAX(patch->xyz[1], DARK), -4.0 / 3);
}

/* Computes the inverse of Σ w·rgb·rgbᵀ. Returns FALSE if the patches do not span all colours. */
static gboolean colour_invert(const struct colour_patch *patches, int n, double ret[9]) {
    memset(ret, 0, 9 * sizeof *ret);
    double trace = 0;
    for (int i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                ret[3 * a + b] +=
                    colour_weight_of(&patches[i]) * patches[i].rgb[a] * patches[i].rgb[b];
    for (int a = 0; a < 3; a++)
        trace += ret[4 * a];
    if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', 3, ret, 3) != 0)
        return FALSE;
    for (int a = 0; a < 3; a++)
        if (ret[4 * a] * ret[4 * a] < MIN_PIVOT * trace)
            return FALSE;
    LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', 3, ret, 3);
    ret[1] = ret[3];
    ret[2] = ret[6];
    ret[5] = ret[7];
    return TRUE;
}

/* Computes one row of M and its standard errors √(Σ w r² / (n − 3) · (inverse)ₐₐ), where r are the
 * residuals and a is the column. */
static void fit_row(const struct colour_patch *patches, int n, const double inverse[9], int row,
                    struct colour_matrix *ret) {
    double right[3] = {0}, squares = 0;
    for (int i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            right[a] += colour_weight_of(&patches[i]) * patches[i].rgb[a] * patches[i].xyz[row];
    colour_apply(inverse, right, ret->matrix + 3 * row);
    for (int i = 0; i < n; i++) {
        double off = patches[i].xyz[row];
        for (int a = 0; a < 3; a++)
            off -= ret->matrix[3 * row + a] * patches[i].rgb[a];
        squares += colour_weight_of(&patches[i]) * off * off;
    }
    for (int a = 0; a < 3; a++)
        ret->error[3 * row + a] = sqrt(squares / (n - 3) * inverse[4 * a]);
}

gboolean colour_fit(const struct colour_patch *patches, int n, struct colour_matrix *ret,
                    GError **error) {
    static const double grey[3] = {1, 1, 1};
    struct colour_matrix found = {.known = TRUE, .patches = n};
    double inverse[9], scaled[3], sum = 0;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(patches[i].rgb[k]) || !isfinite(patches[i].xyz[k])) {
                g_set_error(error, COLOUR_ERROR, COLOUR_ERROR_MISFIT,
                            isfinite(patches[i].rgb[k])
                                ? "patch %d: the chart's value is not a number; correct the file "
                                  "of the chart"
                                : "patch %d: the measured colour is not a number; check that the "
                                  "pictures show the whole patch",
                            i + 1);
                return FALSE;
            }
    if (n < FEW_PATCHES) {
        g_set_error(error, COLOUR_ERROR, COLOUR_ERROR_TOO_FEW,
                    "%d patches are too few for nine unknowns and their errors; use a chart with "
                    "at least %d patches of different colours",
                    n, FEW_PATCHES);
        return FALSE;
    }
    if (!colour_invert(patches, n, inverse)) {
        g_set_error(error, COLOUR_ERROR, COLOUR_ERROR_TOO_FEW,
                    "the colours of the patches are too similar; use a chart with red, green and "
                    "blue patches");
        return FALSE;
    }
    for (int row = 0; row < 3; row++)
        fit_row(patches, n, inverse, row, &found);
    /* White has the chromaticity of equal R, G and B, and Y = 1 as in the chart's values. The Y
     * that the matrix gives for white is not used, because that Y depends on how dark the pictures
     * are. */
    colour_apply(found.matrix, grey, scaled);
    const double white[3] = {scaled[0] / scaled[1], 1, scaled[2] / scaled[1]};
    for (int i = 0; i < n; i++) {
        double xyz[3];
        colour_apply(found.matrix, patches[i].rgb, xyz);
        double off = colour_difference(xyz, patches[i].xyz, white);
        sum += off * off / n;
    }
    found.residual = sqrt(sum);
    if (!(scaled[0] > 0 && scaled[1] > 0 && scaled[2] > 0)) {
        g_set_error(
            error, COLOUR_ERROR, COLOUR_ERROR_MISFIT,
            "by the measured colours of the patches, equal red, green and blue have an XYZ "
            "that is not above 0; check that the file of --chart belongs to this chart, and "
            "that the chart lies as this file says");
        return FALSE;
    }
    if (!(found.residual < MAX_OFF)) {
        g_set_error(error, COLOUR_ERROR, COLOUR_ERROR_MISFIT,
                    "the measured colours of the patches differ from the chart's values by %.1f "
                    "ΔE*ab (RMS), and less than %g is needed; check that the file of --chart "
                    "belongs to this chart, and that the chart lies as this file says",
                    found.residual, MAX_OFF);
        return FALSE;
    }
    *ret = found;
    return TRUE;
}
