/*
 * Interpolation over measured directions that differ slightly from texel to texel. The directions
 * are triangulated once, as seen from the centre of the sample. For another texel the corners move
 * a little, but a direction usually stays in the same triangle. The weights are computed from the
 * positions of the corners for that texel.
 *
 * Directions are points x of the stereographic plane, (x, y) / (1 + z). Within a triangle, the
 * value is f(x) = Σ_k b_k (f_k + ½ g_k · (x − x_k)). x_k are the corners, b_k the barycentric
 * weights, and f_k the values. g_k is the gradient of the quadric that is fitted to the values
 * around corner k. This is exact for every quadric. Linear interpolation would lower highlights,
 * and more so farther from the nominal direction.
 *
 * Outside of all triangles, the nearest triangle is extrapolated by up to half its height, because
 * near the horizon half of the texels were seen from less oblique directions than the nominal one.
 * Beyond that limit the value is constant; for lights it decreases with the cosine. If there are no
 * triangles (fewer than three directions, or all are collinear), the nearest direction is used. Any
 * thread; immutable once made.
 */
#pragma once

#include "base/vec.h"
#include <glib.h>

typedef struct DirectionMesh DirectionMesh;

/* Makes a mesh. Directions within ¼° of an earlier one (⅛° at the horizon) are left out. If `skip`
 * is not −1, the direction with the index `skip` is left out as well. At least one direction must
 * remain. `lights` says whether the directions are lights; beyond the limit of extrapolation, the
 * value then decreases with the cosine. */
DirectionMesh *direction_mesh_new(const struct vec3 *directions, int n, int skip, gboolean lights);
void direction_mesh_free(DirectionMesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(DirectionMesh, direction_mesh_free)

/* Gives the direction's point in the stereographic plane. */
void direction_mesh_point(struct vec3 direction, double ret[2]);

/* A guess lists the triangles that most likely contain a direction. These triangles are searched
 * first. direction_mesh_guess() makes the guess for a direction. */
#define DIRECTION_MESH_GUESSES 24
struct direction_guess {
    int n, triangle[DIRECTION_MESH_GUESSES];
};
void direction_mesh_guess(const DirectionMesh *mesh, struct vec3 direction,
                          struct direction_guess *ret);

/* An interpolated value: Σ_k weight_k × (value_k + along_k · gradient_k) over three corners. */
struct direction_share {
    int corner[3];
    float weight[3], along[3][2]; /* along: x and y in the stereographic plane */
    /* TRUE beyond the limit of extrapolation, or if there are no triangles */
    gboolean clamped;
};

/* Computes the corners and weights that interpolate the value at the projected direction `at`.
 * points (n × 2) are the projected directions of the mesh as seen from one texel. */
void direction_mesh_share(const DirectionMesh *mesh, const double *points, const double at[2],
                          const struct direction_guess *guess, struct direction_share *ret);

/* Computes the gradient (d/dx, d/dy) at each direction: ret (n × 2 × row) from values (n × row).
 * row is a multiple of 4. The gradient is 0 at a direction that was left out, and where fewer than
 * five directions are near. */
void direction_mesh_slopes(const DirectionMesh *mesh, const float *values, int row, float *ret);

/* Adds to ret_weights (n) the weight of each of the n values in the interpolated value, including
 * the weights that the gradients contribute. */
void direction_mesh_weights(const DirectionMesh *mesh, const struct direction_share *share,
                            float *ret_weights);
