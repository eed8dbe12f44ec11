/* Merges the candidates of one texel from all laser positions (Wang et al. 2005 §3.2, Merging):
 * private to mdf.h. Any thread. */
#pragma once

#define MDF_BENDS 4

struct mdf_candidate {
    float mm, dn;             /* distance; height of the pulse in DN */
    float shown;              /* share of the pixels around that saw a line */
    float bend_mm[MDF_BENDS]; /* mdf_errors.h: over one pixel along x, y, and two; NAN: unknown */
    float tolerance_mm;       /* > 0: others this close always agree with it */
    float frame_mm;           /* > 0: depth of a frame of the sweep, along the ray */
    int sweep;                /* at most one of a sweep's candidates is right */
    double weight;
};

/* What merged sweeps say of the error of their mean (mdf_errors.h). */
struct mdf_spread {
    int n;                     /* sweeps */
    double frames2, freedom;   /* u, and its degrees of freedom; 0: fewer than two sweeps */
    double unit_mm2;           /* V */
    double hidden;             /* h */
    double bend_mm[MDF_BENDS]; /* their mean bends; NAN: unknown */
    double noise_mm2[MDF_BENDS];
};

struct mdf_merged {
    float mm; /* −1: unknown */
    int n;    /* number of sweeps averaged */
    struct mdf_spread spread;
};

/* candidates: those of a sweep are consecutive; they are reordered. least: with fewer agreeing
 * sweeps the result is unknown. The true line shows the same surface for every laser position,
 * while reflections and highlights appear at times that depend on the position. Therefore the mode
 * is the distance with the support of most of the sweeps' weight, each sweep contributes its
 * candidate closest to the mode, and sweeps without a close one are outliers. */
struct mdf_merged mdf_merge(struct mdf_candidate *candidates, int n, int least);
