/*
 * Marching of a ray through the shell of a curved mesh. Surfaces at a constant depth below the mesh
 * are parallel to it, and the length of a texture coordinate changes along the mesh.
 * renderer/shaders/curved.glsl and shell.glsl do the same on the graphics card.
 */
#pragma once

#include "mdf_shell.h"

/* The mesh at the point where a ray enters. Lengths are in any unit, the same for all. For a flat
 * sample, tile is its size and all other members are 0. */
struct shell_surface {
    double tile[2]; /* length of a tile along u and along v */
    /* Second fundamental form (L, M, N) along tangent and bitangent. The normal curvature is
     * positive where the mesh bends away from the outward normal. */
    double bend[3];
    double stretch[4]; /* gradients of ln tile[0] and of ln tile[1] along tangent and bitangent */
};

/* The point where a ray meets the structure. */
struct shell_hit {
    double distance; /* distance along the ray from the mesh, in the unit of the surface */
    double depth_mm; /* depth in mm below the reference plane of the flat sample */
    double u, v;     /* the nearest point of the mesh, in tiles; v is along the rows, downwards */
    double view[3];  /* unit vector against the ray, in the frame of the mesh at (u, v) */
};

/* Marches a ray that enters the mesh at (u, v). view is the unit vector against the ray in the
 * frame of tangent, bitangent and normal there, above the horizon. limit is the distance at which
 * the ray ends, in the unit of the surface, or INFINITY.
 *
 * Returns whether the ray meets the structure before limit. A ray that goes below all structure
 * counts as meeting the structure at its base. Any thread. */
gboolean shell_ray_march(const struct mdf_shell *shell, const struct shell_surface *surface,
                         double u, double v, const double view[3], double limit,
                         struct shell_hit *ret);

/* Returns g of mdf_shell.h. ret_gradient receives the gradient of g along x, y (upwards) and the
 * outward normal, per mm. */
double shell_ray_value(const struct mdf_shell *shell, double u, double v, double depth_mm,
                       double ret_gradient[3]);
