/*
 * Eigen-BRDFs on a regular grid of directions, which a graphics card can interpolate in hardware
 * (Schneider 2004 §6). The elevated concentric map Ω (§6.1) maps the unit square to the hemisphere:
 * concentric squares become rings, and equal areas become equal solid angles. With (a, b) = (2s −
 * 1, 2t − 1),
 *   ρ = a, φ = π/4 · b/a             if |a| > |b|,
 *   ρ = b, φ = π/2 − π/4 · a/b       otherwise;
 *   (x, y, z) = (ρ √(2 − ρ²) cos φ, ρ √(2 − ρ²) sin φ, 1 − ρ²).
 * s = t = ½ is the zenith, and the square's edge is the horizon.
 *
 * A grid of n has a sample at each s, t = i/(n − 1), i = 0 … n − 1. Sample (i, j), at s = i/(n −
 * 1), t = j/(n − 1), has the number j · n + i. Values between samples are bilinear. In a texture of
 * n × n texels, s is at the texture coordinate (s (n − 1) + ½)/n.
 *
 * The samples are linear in the measured values. First, the measured values are interpolated
 * smoothly over the hemisphere (with the kernel |ω − ω_i| and a linear part). Below the lowest
 * measured direction, the value at the elevation of that lowest direction is used; for lights this
 * value is multiplied by the ratio of the cosines, because reflectances contain n·l. Then the
 * samples are chosen so that their bilinear interpolant is close to the smooth function everywhere,
 * and to the measured values in their directions. The second condition is weakened where it would
 * make samples oscillate. Pure functions, any thread.
 */
#pragma once

#include "btf_layout.h"

#define DIRECTION_GRID_MIN 4
#define DIRECTION_GRID_MAX 24

/* direction_grid_direction() computes Ω, direction_grid_square() the inverse of Ω. Directions are
 * unit vectors. A direction below the horizon is treated as if it were on the horizon. */
void direction_grid_direction(double s, double t, float ret[3]);
void direction_grid_square(const float direction[3], double *ret_s, double *ret_t);

/* Gives the four samples around a direction and their bilinear weights, which are not negative
 * and sum to 1. */
void direction_grid_weights(int n_grid, const float direction[3], int ret_index[4],
                            float ret_weight[4]);

/* Returns the matrix (n_grid² × n) that maps values at the n directions to samples; g_free().
 * `lights` says whether the directions are lights. Below the lowest direction, values are then
 * multiplied by the ratio of the cosines (see above). The error is DATA_ERROR_INVALID if
 * n_grid is out of bounds, if there are no directions or more than 4096, if a direction is not
 * finite or below the horizon, or if LAPACK cannot compute the smooth interpolant. */
float *direction_grid_operator(const struct direction_list *list, int n_grid, gboolean lights,
                               GError **error);

/* Returns the directions of the n_grid² samples; free with direction_list_clear(). */
struct direction_list direction_grid_samples(int n_grid);
