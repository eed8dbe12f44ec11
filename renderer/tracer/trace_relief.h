/* Decides whether a ray that grazes a mesh meets the relief of its captured material, or passes
 * above it. */
#pragma once

#include "trace_surface.h"

/* Returns whether a ray meets the relief between `front`, where it goes below the mesh, and `back`,
 * where it leaves the mesh. direction is the unit vector along the ray. Any thread may call this
 * function.
 *
 * The ray is followed in two marches (mesorig_material_march(); Wang et al. 2005 §4.1), as in
 * renderer/shaders/shell.glsl. One march begins at `front` and covers the first half of the way,
 * with the curvature of the mesh at `front`. The other march begins at `back` and covers the second
 * half, with the curvature at `back`.
 *
 * Also returns TRUE if a march fails, if the ray does not go below the mesh at `front`, or if it
 * does not come out at `back`. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction);
