/* Decides whether a ray that grazes a mesh meets the relief of its captured material, or passes
 * above it. */
#pragma once

#include "trace_surface.h"

/* Returns whether a ray meets the relief between front, where it goes below the mesh, and back,
 * where it leaves the mesh. direction is the unit vector along the ray. Between the two, the mesh
 * is approximated by a parabola above the ray. Its height is d_z t (1 − t / w) at the distance t
 * from either end. w is the distance between the ends and d_z the cosine to the normal at that end.
 * The MDF contains distances along rays over a flat surface. It is therefore evaluated for chords
 * of the parabola, as in Wang et al. 2005 §4.1 and renderer/shaders/relief.glsl. Any thread may
 * call it. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction);
