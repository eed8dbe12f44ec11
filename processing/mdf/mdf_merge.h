/*
 * What all laser positions say of one texel (Wang et al. 2005 §3.2, Merging): private to mdf.h. Any
 * thread.
 */
#pragma once

struct mdf_candidate {
    float mm, dn; /* distance, how bright */
    int sweep;    /* of several of one sweep, one at most is right */
    double weight;
};

struct mdf_merged {
    float mm;       /* −1: not known */
    int n;          /* sweeps that it is the mean of */
    float error_mm; /* standard error; −1: of fewer than two */
};

/* Candidates of a sweep lie one after the other; their order is changed. least: with fewer sweeps
 * that agree nothing is known.
 *
 * The true line of every laser shows the same surface; light thrown back by what stands around, and
 * highlights of other places, come at times that depend on where the laser stands. So the distance
 * that most of the sweeps' weight agrees on is looked for, each sweep counts by that candidate of
 * its that is next to it, and those that have none near are outliers. */
struct mdf_merged mdf_merge(struct mdf_candidate *candidates, int n, int least);
