/* Compares the laser's lines in the reference region with the calibration: statistics over
 * sweeps. */
#pragma once

#include "exr/exr.h"

struct mdf_lines {
    /* sweeps: number of all sweeps
     * found: number of sweeps with a line
     * disagree: number of sweeps whose line contradicts the calibration */
    int sweeps, found, disagree;
    /* sum of squared angle errors of the sheets, over the sweeps with a line */
    double squares_deg2;
    /* signed angle error with the largest absolute value: among the sweeps that disagree, or among
     * all sweeps with a line if no sweep disagrees */
    double worst_deg;
    int worst_position; /* laser position of worst_deg; −1 if no line was found */
    /* width, scatter: means over views of the members of struct mdf_light (mdf.h)
     * widths, scatters: numbers of views of which width and scatter are known */
    double width, scatter;
    int widths, scatters;
};
/* Write and read the attributes lines.* of a part of products/mdf.exr. lines.width and
 * lines.scatter are written only if they are known. Reading returns FALSE if any other attribute is
 * missing. */
void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines);
gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret);

/* Returns a sentence for the user, with the possible causes, if the laser's light is unusual on the
 * sample; g_free(). Otherwise returns NULL. The light is unusual if lines are much wider than on
 * plates, or if times scatter by a large part of the line's width. width and scatter are those of
 * struct mdf_lines; 0 means unknown. */
char *mdf_lines_warning(double width, double scatter);

/* Adds the statistics `more` of further views to `to`. */
void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more);
