/* Several processes that compress one BTF together. Each process has a number, its rank, and a part
 * of the texels in memory. */
#pragma once

#include <glib.h>

#define TEAM_ROWS 256 /* texels are distributed in multiples of this number */

/* Collective operations. All ranks make the same calls in the same order. Each call waits for all
 * ranks. */
struct team {
    int rank, n_ranks; /* rank is 0 … n_ranks − 1 */
    gpointer data;     /* for the functions of this struct */
    /* Replaces the array `values` of every rank by the sum of the arrays of all ranks, element by
     * element. */
    void (*sum_floats)(const struct team *team, float *values, gsize n);
    void (*sum_doubles)(const struct team *team, double *values, gsize n);
    /* Gathers data in all ranks. Rank i has filled the bytes starts[i] … starts[i + 1] − 1 of the
     * array `all`. Afterwards the array is complete in each rank. starts has n_ranks + 1
     * numbers. */
    void (*share)(const struct team *team, void *all, const gsize *starts);
    /* Scatters data. Only the rank `root` has the array `all`. Rank i receives the values starts[i]
     * … starts[i + 1] − 1 in ret_mine. */
    void (*deal)(const struct team *team, int root, const float *all, const gsize *starts,
                 float *ret_mine);
};

/* Computes the part of n items that belongs to a rank: *ret_first … *ret_end − 1. Parts begin at
 * multiples of step. If team is NULL, rank 0 has all items. */
void team_part(const struct team *team, int rank, int n, int step, int *ret_first, int *ret_end);
