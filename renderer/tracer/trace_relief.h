/* Decides whether a ray that grazes a mesh meets the relief of its captured material, or passes
 * above it. */
#pragma once

#include "trace_surface.h"

/* Returns whether a ray meets the relief between `front`, where the ray goes below the mesh, and
 * `back`, where the ray leaves the mesh. direction is the unit vector along the ray. The function
 * follows the ray through the relief in two marches. One march begins at `front` and covers the
 * first half of the way, with the curvature of the mesh at `front`. The other march begins at
 * `back` and covers the second half, with the curvature of the mesh at `back`
 * (mesorig_material_march(); Wang et al. 2005 §4.1). renderer/shaders/shell.glsl does the same.
 * Also returns TRUE if a march fails, or if the ray does not go below the mesh at `front`, or does
 * not come out at `back`. Any thread may call this function. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction);
