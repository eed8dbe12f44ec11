/*
 * Eigen-BRDFs on a regular grid of directions, which a graphics card interpolates by itself
 * (Schneider 2004 §6). The hemisphere is the unit square by the elevated concentric map Ω (§6.1):
 * concentric squares become rings, equal areas equal solid angles. With (a, b) = (2s − 1, 2t − 1),
 * where |a| > |b|: ρ = a, φ = π/4 · b/a, else ρ = b, φ = π/2 − π/4 · a/b; then (x, y, z) = (ρ √(2 −
 * ρ²) cos φ, ρ √(2 − ρ²) sin φ, 1 − ρ²). s and t = ½ is the zenith, the square's edge the horizon.
 *
 * A grid of n has a sample at each s, t = i/(n − 1), i = 0 … n − 1, sample (i, j) of (s, t) being
 * number j · n + i; between them values are bilinear. As a texture of n texels a side s lies at the
 * coordinate (s (n − 1) + ½)/n.
 *
 * The samples are linear in the measured values. Those are first interpolated smoothly over the
 * hemisphere (|ω − ω_i| as kernel, and a linear part); below the lowest of them the value of that
 * elevation holds, for lights in proportion to the cosine, since reflectances hold n·l. The samples
 * are those whose bilinear interpolant is nearest to that function everywhere, and to the measured
 * values in their directions, as far as this makes no sample oscillate. Pure functions, any thread.
 */
#pragma once

#include "btf_layout.h"

#define DIRECTION_GRID_MIN 4
#define DIRECTION_GRID_MAX 24

/* Ω and its inverse; directions are unit vectors, and below the horizon count as in it. */
void direction_grid_direction(double s, double t, float ret[3]);
void direction_grid_square(const float direction[3], double *ret_s, double *ret_t);

/* The four samples around a direction and their bilinear weights: not negative, sum 1. */
void direction_grid_weights(int n_grid, const float direction[3], int ret_index[4],
                            float ret_weight[4]);

/* The matrix (n_grid² × n; g_free()) from values at the n directions to samples. lights: see above.
 * DATA_ERROR_INVALID: a grid size out of bounds, no directions, or invalid ones. */
float *direction_grid_operator(const struct direction_list *list, int n_grid, gboolean lights,
                               GError **error);

/* Returns the directions of the n_grid² samples; free with direction_list_clear(). */
struct direction_list direction_grid_samples(int n_grid);
