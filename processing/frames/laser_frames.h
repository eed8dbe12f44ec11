/*
 * Computes the angle error of the sheet of light in each frame from the lines that were seen in a
 * sweep's frames: private to laser_lines.h. A few consecutive frames may show light that the sample
 * reflects onto its surround. Therefore the deviation of a single frame counts only as far as
 * neighbouring frames confirm it, or as single frames are known to deviate. All spreads are medians
 * of absolute deviations. Any thread.
 */
#pragma once

struct laser_frames {
    int n;
    /* of each frame, rad: measured minus commanded sheet angle; NAN if there is no line */
    double *middle;
    double *error; /* its standard error */
    /* Results, n values each: */
    double *level; /* median of all frames, or of near frames if that differs */
    /* the frame's own deviation from its level, as far as it exceeds its error */
    double *own;
    double offset, offset_error; /* mean over the sweep, and its standard error */
    int lines;                   /* number of frames with a line */
};

/* Computes the results. At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
