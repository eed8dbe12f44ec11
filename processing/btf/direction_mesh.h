/*
 * Interpolation over measured directions that are not quite the same for every texel. Directions
 * are triangulated once, as the middle of the sample sees them; a texel moves the corners (by the
 * distances of cameras and lamps, smoothly), but which three surround a direction hardly changes,
 * and weights follow from where the corners are for that texel.
 *
 * Directions lie in the stereographic plane, (x, y) / (1 + z). Within a triangle with corners x_k,
 * barycentric weights b_k, values f_k and slopes g_k (of the quadric that fits the values around a
 * corner best), f(x) = Σ b_k (f_k + ½ g_k · (x − x_k)), which is exact for every quadric: 1D, with
 * f = x² and corners 0 and 1, is x (1 + ½ · 2 (x − 1)) = x². Straight interpolation would lower a
 * highlight by as much as a nominal direction misses it.
 *
 * Outside of all triangles the nearest one is extrapolated by up to half its height, since at the
 * border half of the texels have been seen from less far out than is asked for; what is held beyond
 * falls, for lights, with the cosine. Without triangles (fewer than three directions, or all in a
 * line) the nearest direction stands for all. Any thread; not changed after it was made.
 */
#pragma once

#include "base/vec.h"
#include <glib.h>

typedef struct DirectionMesh DirectionMesh;

/* Directions within a quarter of a degree of an earlier one are left out. skip: another to be left
 * out; −1: none. */
DirectionMesh *direction_mesh_new(const struct vec3 *directions, int n, int skip, gboolean lights);
void direction_mesh_free(DirectionMesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(DirectionMesh, direction_mesh_free)

void direction_mesh_point(struct vec3 direction, double ret[2]);

/* Where to look for a direction first. */
#define DIRECTION_MESH_GUESSES 24
struct direction_guess {
    int n, triangle[DIRECTION_MESH_GUESSES];
};
void direction_mesh_guess(const DirectionMesh *mesh, struct vec3 direction,
                          struct direction_guess *ret);

/* What a value is: Σ weight × (value + along · slope) of the corners. */
struct direction_share {
    int corner[3];
    float weight[3], along[3][2]; /* 1 / units of the plane */
    gboolean held;                /* beyond what is extrapolated */
};

/* points: n × 2, where the directions are for this texel; at: of the direction asked for. */
void direction_mesh_share(const DirectionMesh *mesh, const double *points, const double at[2],
                          const struct direction_guess *guess, struct direction_share *ret);

/* Slopes by x and by y at each direction, n × 2 × row, of n × row values. row is a multiple of 4,
 * and both are as GLib aligns. */
void direction_mesh_slopes(const DirectionMesh *mesh, const float *values, int row, float *ret);

/* Adds what each of the n values counts to ret_weights (n): slopes expanded. */
void direction_mesh_weights(const DirectionMesh *mesh, const struct direction_share *share,
                            float *ret_weights);
