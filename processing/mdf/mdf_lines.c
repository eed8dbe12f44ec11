#include "mdf_lines.h"

#include <math.h>

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
}

void mdf_lines_write(struct exr_part *part, const struct mdf_lines *lines) {
    exr_set_int(part, "lines.sweeps", lines->sweeps);
    exr_set_int(part, "lines.found", lines->found);
    exr_set_int(part, "lines.disagree", lines->disagree);
    exr_set_double(part, "lines.rms_deg", sqrt(lines->squares_deg2 / MAX(lines->found, 1)));
    exr_set_double(part, "lines.worst_deg", lines->worst_deg);
    exr_set_int(part, "lines.worst_position", lines->worst_position);
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
    return TRUE;
}
