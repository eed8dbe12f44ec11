/*
 * Computes the angle error of the sheet of light in each frame from the lines that were seen in a
 * sweep's frames: private to laser_lines.h. A few consecutive frames may show light that the sample
 * reflects onto its surround. Therefore a deviation counts in full only if many neighbouring frames
 * have it. The deviation of a single frame is reduced if the standard errors explain most of the
 * spread of all frames. All spreads are medians of absolute deviations. Any thread.
 */
#pragma once

struct laser_frames {
    int n; /* number of frames */
    /* The caller sets middle and error, n values each. middle is the measured minus the commanded
     * sheet angle of each frame, in rad, or NAN if there is no line. */
    double *middle;
    double *error; /* standard error of middle, rad */
    /* level and own are results, n values each, allocated by the caller. level, in rad, is a median
     * of middle plus a shift. The median is that of all frames. If the median of the 21 nearest
     * frames with a line differs significantly, that median is used. The shift is the same for all
     * frames: the robust mean of the deviations of middle from the medians. A frame without a line
     * has the level of the nearest frame with a line. */
    double *level;
    /* deviation of middle from level, in rad, reduced according to its error; 0 for outliers and
     * for frames without a line */
    double *own;
    /* offset and offset_error are results, in rad. offset is the mean level of the frames with a
     * line, and offset_error is its standard error. offset_error is INFINITY if all frames count as
     * outliers. */
    double offset, offset_error;
    int lines; /* result: number of frames with a line */
};

/* Computes the results. At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
