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
 * the centres of the voxels. The surface is where g (mdf_shell.h) has the median of its values at
 * the points where the measured rays of the table stop, limited to 0.05 … 0.95. The space below the
 * shell is solid over the height of a layer. Walls close the mesh at the four sides of the tile,
 * and a floor below. Each edge of a triangle is also an edge of another one, in the opposite
 * direction. Any thread. */
struct mdf_mesh *mdf_mesh_new(const struct mdf_shell *shell, const struct mdf_table *table);

typedef struct mdf_mesh MdfMesh;
void mdf_mesh_free(struct mdf_mesh *mesh); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfMesh, mdf_mesh_free)
