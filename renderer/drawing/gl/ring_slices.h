/* Directions on rings as the third axis of a 3D texture (Wang et al. 2005 §5). A ring takes a slice
 * for each of its directions, and a last slice that repeats the first direction. The filter of the
 * texture interpolates between neighbouring directions of a ring. A shader mixes two rings. */
#pragma once

#include <glib.h>

#define RING_SLICES_MAX 16

struct ring_slices {
    int n_rings, n_slices;
    /* For each ring:
     * [0]  θ in rad
     * [1]  centre of the first slice, counted in slices
     * [2]  number of directions
     * [3]  φ of the first direction in turns */
    float rings[RING_SLICES_MAX][4];
};

/* Finds the rings of n directions. Returns FALSE if the directions cannot be drawn as rings. They
 * must form at most RING_SLICES_MAX rings, in the order of increasing θ, and the directions of each
 * ring must be evenly spaced in φ. Any thread. */
gboolean ring_slices_find(const float *theta_deg, const float *phi_deg, int n,
                          struct ring_slices *ret);

/* Returns the index of the direction to which a slice belongs. Any thread. */
int ring_slices_direction(const struct ring_slices *rings, int slice);
