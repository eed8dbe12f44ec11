/* Statistics of the laser's lines in the reference region against the calibration, over sweeps. */
#pragma once

#include "exr/exr.h"

struct mdf_lines {
    int sweeps, found, disagree; /* all; with a line; with one that contradicts the calibration */
    double squares_deg2;         /* sum of squared angle errors of the sheets, over found */
    double worst_deg;   /* largest signed error, of those that disagree, or of all if none does */
    int worst_position; /* its laser position; −1: no line was found */
};
/* Writes, reads the attributes lines.* of a part of products/mdf.exr; FALSE: they are missing. */
void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines);
gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret);

/* Adds the statistics of further views. */
void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more);
