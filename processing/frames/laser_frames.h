/*
 * Computes the angle error of the sheet of light in each frame from the lines that were seen in a
 * sweep's frames: private to laser_lines.h. A few consecutive frames may show light that the sample
 * reflects onto its surround. Therefore a deviation counts in full only if many neighbouring frames
 * have it. The deviation of a single frame counts only as far as the spread of all frames makes it
 * credible. All spreads are medians of absolute deviations. Any thread.
 */
#pragma once

struct laser_frames {
    int n; /* number of frames */
    /* Given by the caller, n values each. middle, rad: measured minus commanded sheet angle of each
     * frame; NAN if there is no line */
    double *middle;
    double *error; /* standard error of middle, rad */
    /* Results, n values each, allocated by the caller. level, rad: a median of middle plus a shift.
     * The median is taken over all frames, or over the 21 nearest frames with a line if these two
     * medians differ significantly. The shift is the same for all frames: the robust mean of the
     * deviations of middle from the medians. A frame without a line has the level of the nearest
     * frame with a line. */
    double *level;
    /* rad: deviation of middle from level, shrunk according to its error; 0 for outliers and for
     * frames without a line */
    double *own;
    /* Result, rad: offset is the mean level of the frames with a line, and offset_error is the
     * standard error of offset. offset_error is INFINITY if all frames count as outliers. */
    double offset, offset_error;
    int lines; /* result: number of frames with a line */
};

/* Computes the results. At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
