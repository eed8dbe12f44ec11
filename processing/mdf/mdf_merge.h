/* Merges the candidates of one texel from all laser positions (Wang et al. 2005 §3.2, Merging):
 * private to mdf.h. Any thread. */
#pragma once

#define MDF_BENDS 4

struct mdf_candidate {
    /* mm: distance along the texel's ray from the reference plane
     * dn: height of the pulse in DN */
    float mm, dn;
    float shown; /* share of the pixels around the texel that saw a line */
    /* Bends along x and y over one spacing of the pixels that see the laser, then along x and y
     * over two spacings (mdf_errors.h). NAN if unknown. */
    float bend_mm[MDF_BENDS];
    /* > 0; a candidate agrees with the mode if it is at most this far from it */
    float tolerance_mm;
    float frame_mm; /* > 0: depth of a frame of the sweep, along the ray */
    int sweep;      /* number of the sweep; at most one candidate of a sweep is right */
    double weight;
};

/* Data of merged sweeps from which the error of their mean follows, see mdf_errors.h. */
struct mdf_spread {
    int n; /* number of sweeps */
    /* frames2: u of mdf_errors.h, in frames²
     * freedom: ν of mdf_errors.h; 0 if there are fewer than two sweeps */
    double frames2, freedom;
    double unit_mm2;             /* V of mdf_errors.h */
    double hidden;               /* h of mdf_errors.h */
    double bend_mm[MDF_BENDS];   /* mean bends of the sweeps; NAN if unknown */
    double noise_mm2[MDF_BENDS]; /* variances of these means; 0 for fewer than two sweeps */
};

struct mdf_merged {
    float mm; /* distance along the texel's ray from the reference plane; −1 if unknown */
    int n;    /* number of sweeps that were averaged; 0 if the distance is unknown */
    struct mdf_spread spread;
};

/* Merges the candidates of a texel. The candidates of a sweep are consecutive. The function
 * reorders the array: the candidates that were averaged become the first ones. If fewer than
 * `least` sweeps agree, the result is unknown.
 *
 * The true line shows the same surface for every laser position, whereas reflections and highlights
 * appear at times that depend on the position. Therefore the mode is the distance at which the
 * candidates of the sweeps have the largest sum of weights. Each sweep contributes its candidate
 * that is closest to the mode. A sweep is an outlier if its candidate is too far from the mode. */
struct mdf_merged mdf_merge(struct mdf_candidate *candidates, int n, int least);

/* Merges as printed in Wang et al. 2005 §3.2, for comparison: returns the mean of all candidates by
 * their weights. Each sweep may have only one candidate. */
struct mdf_merged mdf_merge_mean(const struct mdf_candidate *candidates, int n);
