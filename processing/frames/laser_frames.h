/*
 * From the lines seen in a sweep's frames to each frame's angle error of the sheet of light:
 * private to laser_lines.h. A few consecutive frames may show light that the sample reflects onto
 * its surround. Therefore a frame counts only as far as its neighbours confirm it, or as frames are
 * known to deviate singly, and all spreads are medians of absolute deviations. Any thread.
 */
#pragma once

struct laser_frames {
    int n;
    /* of each frame, rad: measured minus commanded sheet angle; NAN if there is no line */
    double *middle;
    double *error; /* its standard error */
    /* Results, n values each: */
    double *level; /* running median of the frames around */
    /* the frame's own deviation from its level, as far as it exceeds its error */
    double *own;
    double offset, offset_error; /* mean over the sweep, and its standard error */
    int lines;                   /* number of frames with a line */
};

/* Computes the results. At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
