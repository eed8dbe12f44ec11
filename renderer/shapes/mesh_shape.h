/*
 * Local geometry of a mesh at each vertex: the scale of the texture coordinates and the curvature.
 * Both are estimated from the triangles around the vertex.
 */
#pragma once

#include "scene.h"

struct vertex_shape {
    /* Lengths |dP/du| and |dP/dv| on the mesh of a step of 1 in u, and in v (s of Wang et al.
     * 2005). */
    float scale[2];
    /* Second fundamental form (L, M, N) along tangent and bitangent. The normal curvature along the
     * unit direction (a, b) is L a² + 2 M a b + N b². This curvature is positive where the surface
     * bends away from its normal. */
    float bend[3];
    /* Gradients of ln scale[0] and of ln scale[1] along tangent and bitangent, per unit of length:
     * (∂ ln scale[0] / ∂t, ∂ ln scale[0] / ∂b, ∂ ln scale[1] / ∂t, ∂ ln scale[1] / ∂b) */
    float stretch[4];
};

/* Returns one element per vertex. Free them with g_free(). */
struct vertex_shape *mesh_shapes(const struct mesh *mesh);
