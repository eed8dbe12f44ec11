/* Whether a ray that grazes a mesh meets the relief of its captured material, or passes above it.
 */
#pragma once

#include "trace_scene.h"

/* The ray comes along direction, a unit vector, through front, where it goes below the mesh, and
 * leaves through back. Between them the mesh is taken for a parabola above the ray, whose height is
 * d_z t (1 − t / w) at the distance t from either end, w being the way between them and d_z the
 * cosine to that end's normal. The MDF, which is that of rays over a flat surface, is asked for
 * chords of it, as Wang et al. 2005 §4.1 and renderer/shaders/relief.glsl have it. Any thread. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction);
