/* What the laser's lines beside the sample said of the calibration, summed over sweeps. */
#pragma once

#include "exr/exr.h"

/* What lines in the reference region said of the sweeps' planes. */
struct mdf_lines {
    int sweeps, found, disagree; /* found: with a line; disagree: of them, with the calibration */
    double squares_deg2;         /* of the sheets' angles against the calibration, found */
    double worst_deg;            /* of those that disagree, or else of all; signed */
    int worst_position;          /* laser position; −1: no line was found */
};
/* As attributes lines.* of a part of products/mdf.exr; reading is FALSE if it does not say. */
void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines);
gboolean mdf_lines_read(const struct exr_part *part, struct mdf_lines *ret);

/* Adds those of one view or of several. */
void mdf_lines_add(struct mdf_lines *to, const struct mdf_lines *more);
