/* Decides whether a ray that grazes a mesh meets the relief of its captured material, or passes
 * above it. */
#pragma once

#include "trace_surface.h"

/* Returns whether a ray meets the relief between `front`, where the ray goes below the mesh, and
 * `back`, where the ray leaves the mesh. direction is the unit vector along the ray. The first half
 * of the way is marched through the relief from front, and the second half from back, with the
 * curvature of the mesh there (mesorig_material_march(); Wang et al. 2005 §4.1), as
 * renderer/shaders/shell.glsl does. Also returns TRUE if the march fails, or if the ray does not go
 * below the mesh at `front` and come out at `back`. Any thread may call it. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction);
