/* Statistics of the laser's lines in the reference region against the calibration, over sweeps. */
#pragma once

#include "exr/exr.h"

struct mdf_lines {
    int sweeps, found, disagree; /* all; with a line; with one that contradicts the calibration */
    double squares_deg2;         /* sum of squared angle errors of the sheets, over found */
    double worst_deg;   /* largest signed error, of those that disagree, or of all if none does */
    int worst_position; /* its laser position; −1: no line was found */
    /* Means over views of struct mdf_light (mdf.h), and numbers of views that know it. */
    double width, scatter;
    int widths, scatters;
};
/* Writes, reads the attributes lines.* of a part of products/mdf.exr; FALSE: they are missing. */
void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines);
gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret);

/* A sentence for the user, or NULL, about how the laser's light lies on the sample, with the causes
 * that fit: lines that are much wider than on plates, or times that scatter by much of the line's
 * width. width, scatter: of struct mdf_lines; 0: not known. g_free(). */
char *mdf_lines_warning(double width, double scatter);

/* Adds the statistics of further views. */
void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more);
