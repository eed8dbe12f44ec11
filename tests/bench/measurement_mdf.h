/* The MDF's part of bench_measurement. */
#pragma once

#include "measurement_rig.h"

struct bench_mdf {
    gint64 texels, seen, covered; /* seen: by a laser position at least */
    gint64 dark; /* seen, not covered, and shown by no position (measurement_shown.h) */
    gint64 measured, outliers; /* outliers: more than a texel off, without edges */
    gint64 edges, edge_outliers;
    double squares, edge_squares, sum; /* of errors in texels, without edges and at them */
    GArray *errors;                    /* float: absolute, in texels, without edges */
    /* float: squared errors of texels that have an error bar, in its units: without edges, at them,
     * and of those that one position alone saw (also in the other two) */
    GArray *chi2, *edge_chi2, *alone_chi2;
    gint64 alone, alone_outliers; /* seen by one position alone, at edges or not */
    double alone_squares;
    float *distance, *other, *truth;   /* of each texel, mm; g_free() */
    float *lasers;
    guint8 *edge, *lit;  /* of each texel; lit: by how many positions; g_free() */
    double centre_mm[3]; /* of the camera, sample frame */
};

void bench_mdf_init(struct bench_mdf *mdf);
void bench_mdf_clear(struct bench_mdf *mdf);

/* Of one view, added to ret; with every n-th laser position. */
void bench_mdf(const struct bench_setup *setup, int view, int steps, int every,
               struct bench_mdf *ret);
