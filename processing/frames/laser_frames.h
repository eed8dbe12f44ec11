/*
 * Computes the angle error of the sheet of light in each frame from the lines that were seen in a
 * sweep's frames: private to laser_lines.h. A few consecutive frames may show light that the sample
 * reflects onto its surround. Therefore a deviation counts in full only if many neighbouring frames
 * have it. The deviation of a single frame counts only as far as the spread of all frames makes it
 * credible. All spreads are medians of absolute deviations. Any thread.
 */
#pragma once

struct laser_frames {
    int n;
    /* of each frame, rad: measured minus commanded sheet angle; NAN if there is no line */
    double *middle;
    double *error; /* standard error of middle, rad */
    /* Results, n values each: */
    /* rad: robust mean of middle over all frames, or over the nearest frames if the median of these
     * differs significantly from the median of all frames */
    double *level;
    /* rad: deviation of middle from level, shrunk according to its error; 0 for outliers and for
     * frames without a line */
    double *own;
    double offset, offset_error; /* mean level of frames with a line, and its standard error, rad */
    int lines;                   /* number of frames with a line */
};

/* Computes the results. At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
