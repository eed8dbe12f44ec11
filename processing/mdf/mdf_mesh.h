/* A closed mesh of triangles around the opaque part of a shell. The mesh has the overhangs and
 * holes of the shell. */
#pragma once

#include "mdf_shell.h"

/* z is −depth. x grows with u from 0 to width_mm, and y from 0 at the lowest row to height_mm. */
struct mdf_mesh_vertex {
    float at_mm[3];
    float normal[3]; /* unit vector outwards */
    float uv[2];     /* in tiles; v is along the rows, downwards */
};

struct mdf_mesh {
    struct mdf_mesh_vertex *vertices;
    guint32 *indices; /* three for each triangle, counter-clockwise seen from outside */
    guint n_vertices, n_indices;
};

/* Makes the mesh of one tile, by surface nets (Gibson 1998, “Constrained Elastic Surface Nets”) on
 * the centres of the voxels. The surface is where g (mdf_shell.h) equals a level. The level is the
 * median of g at the points where the measured rays of the table stop, limited to 0.05 … 0.95.
 *
 * A solid layer is added below the shell. The mesh has walls at the four sides of the tile, and a
 * floor. It is closed: each edge of a triangle is also an edge of another triangle, in the opposite
 * direction. Any thread. */
struct mdf_mesh *mdf_mesh_new(const struct mdf_shell *shell, const struct mdf_table *table);

typedef struct mdf_mesh MdfMesh;
void mdf_mesh_free(struct mdf_mesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfMesh, mdf_mesh_free)
