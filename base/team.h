/* Several processes that compress one BTF together, each with some of its texels in memory. */
#pragma once

#include <glib.h>

#define TEAM_ROWS 256 /* texels are shared out in multiples of these */

/* Collective operations. All ranks make the same calls in the same order; each call waits for all.
 */
struct team {
    int rank, n_ranks;
    gpointer data;
    /* Sums the arrays of all ranks element by element; all ranks get the result. */
    void (*sum_floats)(const struct team *team, float *values, gsize n);
    void (*sum_doubles)(const struct team *team, double *values, gsize n);
    /* Gathers data in all ranks: rank i has filled bytes starts[i] … starts[i + 1] − 1; afterwards
     * each rank has all bytes. */
    void (*share)(const struct team *team, void *all, const gsize *starts);
    /* Scatters: only the root has all; rank i gets its values starts[i] … starts[i + 1] − 1. */
    void (*deal)(const struct team *team, int root, const float *all, const gsize *starts,
                 float *ret_mine);
};

/* Gives a rank its part of n things, *ret_first … *ret_end − 1; parts begin at multiples of step.
 */
void team_part(const struct team *team, int rank, int n, int step, int *ret_first, int *ret_end);
