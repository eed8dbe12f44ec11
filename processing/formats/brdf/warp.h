/* Densities on the unit square, tabulated at width × height nodes and bilinear between them. A
 * density defines a map of the square to itself (Dupuy & Jakob 2018 §4; the marginal and
 * conditional distributions of Pharr et al. 2016 §13.6.7). Tables have several slices, one for each
 * direction of incidence. A density between directions is a weighted sum of slices, and so are its
 * cumulative sums.
 *
 * With p(x, y) of the table in units of a cell, x and y counted in cells:
 *   F(j)    = ∫_0^j ∫ p dx dy                        marginal, of rows
 *   F(i|y)  = ∫_0^i p dx at row y                    conditional, linear in y between rows
 *   invert:  s_y = F(j + f_y) , s_x = F(i + f_x | y) / F(width − 1 | y)
 * Within a cell p is linear along each axis, so that ∫_0^f p = f (p_0 + ½ f (p_1 − p_0)). Pure
 * functions; any thread. */
#pragma once

#include <glib.h>

/* A weighted sum of slices. */
struct warp_slices {
    int n, index[4];
    double weight[4];
};

/* A table of numbers. values has n_slices × height × width numbers; x varies fastest. Borrowed. */
struct warp_table {
    int width, height, n_slices;
    const float *values;
};

/* Returns the bilinear interpolant at (x, y), each 0 … 1. If an axis has one node, the table is
 * constant along this axis. */
double warp_table_value(const struct warp_table *table, const struct warp_slices *slices, double x,
                        double y);

typedef struct warp Warp;

/* Makes a warp. values are copied. Returns NULL if a value is negative or not finite, or if a slice
 * is zero everywhere. There must be at least two columns and two rows. */
Warp *warp_new(int width, int height, int n_slices, const float *values);
void warp_free(Warp *warp); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Warp, warp_free)

/* Maps (x, y) to ret, a point of the unit square. If (x, y) is distributed with the density, ret is
 * distributed uniformly. Returns the density at (x, y), scaled so that its integral over the square
 * is 1. */
double warp_invert(const Warp *warp, const struct warp_slices *slices, double x, double y,
                   double ret[2]);

/* The inverse of warp_invert(): maps a uniformly distributed point to one with the density. */
void warp_sample(const Warp *warp, const struct warp_slices *slices, double x, double y,
                 double ret[2]);

/* Finds the two of n ascending nodes between which a value lies: *ret_index and the node after it,
 * whose weight is *ret_weight (0 … 1). A value beyond an end counts as this end. */
void warp_interval(const float *nodes, int n, double value, int *ret_index, double *ret_weight);
