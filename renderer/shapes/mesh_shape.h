/*
 * What a mesh is like around each of its vertices: how large the texture lies on it, and how it
 * bends. Both come from the triangles around a vertex, so any mesh has them.
 */
#pragma once

#include "scene.h"

struct vertex_shape {
    float scale[2]; /* |dP/du| and |dP/dv|: length that a step of 1 in u or v covers (Wang et al.
                       2005 s) */
    /* Second fundamental form (L, M, N) along tangent and bitangent: the normal curvature along the
     * unit direction (a, b) is L a² + 2 M a b + N b², positive where the surface bends away. */
    float bend[3];
};

/* One a vertex; g_free() it. */
struct vertex_shape *mesh_shapes(const struct mesh *mesh);
