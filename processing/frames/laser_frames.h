/*
 * From the lines of a sweep's frames to how far its sheet had turned in each: private to
 * laser_lines.h. A few frames in a row may show what the sample throws on its surround, and nothing
 * of the sheet: what a frame says is believed as far as its neighbours bear it out, or as frames
 * are known to differ. All spreads are medians of sizes, so that such frames do not count. Any
 * thread.
 */
#pragma once

struct laser_frames {
    int n;
    double *middle; /* of each frame, rad: how much further it had turned; NAN: no line */
    double *error;  /* its standard error */
    /* What follows from them, each n values: */
    double *level; /* what a frame says together with those around it */
    double *own;   /* by how much it differs from that, beyond what its error explains */
    double offset, offset_error; /* of all */
    int lines;                   /* frames that have one */
};

/* At least one frame must have a line. */
void laser_frames_settle(struct laser_frames *frames);
