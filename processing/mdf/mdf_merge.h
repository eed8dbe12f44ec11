/*
 * Merges the candidates of one texel from all laser positions (Wang et al. 2005 §3.2, Merging):
 * private to mdf.h. Any thread.
 */
#pragma once

struct mdf_candidate {
    float mm, dn;       /* distance; height of the pulse in DN */
    float tolerance_mm; /* > 0: others this close always agree with it */
    int sweep;          /* at most one of a sweep's candidates is right */
    double weight;
};

struct mdf_merged {
    float mm;       /* −1: unknown */
    int n;          /* number of sweeps averaged */
    float error_mm; /* standard error by their scatter; −1: fewer than two sweeps */
};

/* candidates: those of a sweep are consecutive; they are reordered. least: with fewer agreeing
 * sweeps the result is unknown.
 *
 * The true line shows the same surface for every laser position; reflections from the
 * surroundings and highlights from other parts of the surface appear at times that depend on the
 * position. Therefore the mode is the distance with the support of most of the sweeps' weight, each
 * sweep contributes its candidate closest to the mode, and sweeps without a close one are outliers.
 */
struct mdf_merged mdf_merge(struct mdf_candidate *candidates, int n, int least);
