/* Several processes that compress one BTF together. Each has a part of the texels in memory. */
#pragma once

#include <glib.h>

#define TEAM_ROWS 256 /* texels are distributed in multiples of this number */

/* Collective operations. All ranks make the same calls in the same order. Each call waits for all
 * ranks. */
struct team {
    int rank, n_ranks;
    gpointer data;
    /* Sums the arrays of all ranks element by element; all ranks get the result. */
    void (*sum_floats)(const struct team *team, float *values, gsize n);
    void (*sum_doubles)(const struct team *team, double *values, gsize n);
    /* Gathers data in all ranks. Rank i has filled the bytes starts[i] … starts[i + 1] − 1.
     * Afterwards each rank has all bytes. */
    void (*share)(const struct team *team, void *all, const gsize *starts);
    /* Scatters data. Only the root has all. Rank i receives its values starts[i] … starts[i + 1] −
     * 1. */
    void (*deal)(const struct team *team, int root, const float *all, const gsize *starts,
                 float *ret_mine);
};

/* Returns the part of n items that belongs to a rank, *ret_first … *ret_end − 1. Parts begin at
 * multiples of step. */
void team_part(const struct team *team, int rank, int n, int step, int *ret_first, int *ret_end);
