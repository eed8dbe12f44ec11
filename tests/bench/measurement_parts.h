/* The parts of bench_measurement, a file each. */
#pragma once

#include "end_to_end/demo_pictures.h"
#include "measurement_rig.h"

struct bench_cell { /* a view and a lamp */
    GArray *errors; /* float: of each texel and colour, relative */
    GArray *bias;   /* with their signs */
    int saturated;  /* pixels */
    /* Sums over values of (error / σ)², σ being of noise only, and of noise and structure; values
     * off by more than 3 σ */
    double chi_noise, chi;
    gint64 values, beyond;
};

/* ret: RIG_VIEWS × RIG_VIEWS cells, view by view; errors are appended. picture, if not NULL, gets
 * views and lights of every sort. */
void bench_btf(const struct bench_setup *setup, int truth_samples, struct bench_cell *ret,
               struct demo_btf *picture);

double bench_quantile(GArray *values, double q); /* sorts them */
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
    gint64 alone, alone_outliers; /* seen by one position only, at edges or not */
    double alone_squares;
    float *distance, *other, *truth; /* of each texel, mm; g_free() */
    float *lasers;
    guint8 *edge, *lit;  /* of each texel; lit: by how many positions; g_free() */
    double centre_mm[3]; /* of the camera, sample frame */
};

void bench_mdf_init(struct bench_mdf *mdf);
void bench_mdf_clear(struct bench_mdf *mdf);

/* Of one view, added to ret; with every n-th laser position. plain: see mdf_view_set_plain(). */
void bench_mdf(const struct bench_setup *setup, int view, int steps, int every, gboolean plain,
               struct bench_mdf *ret);

/* How well sweep.h tells a pulse's time, against the Cramér–Rao bound. */
struct bench_peaks {
    double amplitude_dn, bound, rms; /* frames */
    double missed;                   /* part of the pulses: not found, or more than 3 σ away */
};

/* The noise is that of the simulated cameras: 12 bits for 15000 electrons, 4 of read noise.
 * sigma: of the pulse, in frames. */
struct bench_peaks bench_peaks(double amplitude_dn, double sigma);

/* What rectifying costs next to decoding. */
struct bench_speed {
    double decode_ms, rectify_ms, errors_ms; /* a frame */
    double prepare_ms, guide_ms;             /* a view */
};

/* One core, a frame as capture stores it. */
struct bench_speed bench_speed(const struct bench_setup *setup, int view);
