#include "mdf_lines.h"

#include <math.h>

/* Limits of the width and of the scatter. Rough samples that no light enters stay below these
 * limits, see docs/research/accuracy.md. */
#define WIDE    1.1
#define SCATTER 0.07

char *mdf_lines_warning(double width, double scatter) {
    if (scatter > SCATTER)
        return g_strdup_printf(
            "the times of the laser's line scatter from sweep to sweep by %.2f of the line's "
            "width, "
            "but noise and structure explain less than %.2f; possible causes: speckle (use less "
            "coherent laser light, or a larger aperture of the cameras)%s, gloss or structure "
            "finer than the line, a wrong calibration; the MDF's error bars contain the scatter",
            scatter, SCATTER, width > WIDE ? ", light that enters the material" : "");
    if (width > WIDE)
        return g_strdup_printf(
            "the laser's line is %.2f times as wide on the sample as on the plates of its "
            "calibration; possible causes: light that enters the material and comes out next to "
            "the line, steep structure, cameras out of focus; the surface in the MDF may lie "
            "deeper than the true one, and its error bars do not contain this error",
            width);
    return NULL;
}

static double mean_of(double a, int n, double b, int m) {
    return n + m > 0 ? (a * n + b * m) / (n + m) : 0;
}

void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more) {
    const gboolean graver = to->disagree == 0 && more->disagree > 0;
    const gboolean alike = (to->disagree > 0) == (more->disagree > 0);
    if (more->found > 0 &&
        (to->found == 0 || graver || (alike && fabs(more->worst_deg) > fabs(to->worst_deg)))) {
        to->worst_deg = more->worst_deg;
        to->worst_position = more->worst_position;
    }
    to->sweeps += more->sweeps;
    to->found += more->found;
    to->disagree += more->disagree;
    to->squares_deg2 += more->squares_deg2;
    to->width = mean_of(to->width, to->widths, more->width, more->widths);
    to->scatter = mean_of(to->scatter, to->scatters, more->scatter, more->scatters);
    to->widths += more->widths;
    to->scatters += more->scatters;
}

void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines) {
    exr_set_int(part, "lines.sweeps", lines->sweeps);
    exr_set_int(part, "lines.found", lines->found);
    exr_set_int(part, "lines.disagree", lines->disagree);
    exr_set_double(part, "lines.rms_deg", sqrt(lines->squares_deg2 / MAX(lines->found, 1)));
    exr_set_double(part, "lines.worst_deg", lines->worst_deg);
    exr_set_int(part, "lines.worst_position", lines->worst_position);
    if (lines->widths)
        exr_set_double(part, "lines.width", lines->width);
    if (lines->scatters)
        exr_set_double(part, "lines.scatter", lines->scatter);
}

gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret) {
    double rms;
    *ret = (struct mdf_lines){.worst_position = -1};
    if (!exr_get_int(part, "lines.sweeps", &ret->sweeps, NULL) ||
        !exr_get_int(part, "lines.found", &ret->found, NULL) ||
        !exr_get_int(part, "lines.disagree", &ret->disagree, NULL) ||
        !exr_get_double(part, "lines.rms_deg", &rms, NULL) ||
        !exr_get_double(part, "lines.worst_deg", &ret->worst_deg, NULL) ||
        !exr_get_int(part, "lines.worst_position", &ret->worst_position, NULL))
        return FALSE;
    ret->squares_deg2 = rms * rms * ret->found;
    ret->widths = exr_get_double(part, "lines.width", &ret->width, NULL);
    ret->scatters = exr_get_double(part, "lines.scatter", &ret->scatter, NULL);
    return TRUE;
}
