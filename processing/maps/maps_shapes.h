/* The shapes of the scenes that are exported. Lengths are in metres, with y upwards. Any thread. */
#pragma once

#include "maps.h"

/* Number of floats of a vertex: position (3), normal (3), tangent and sign of the bitangent (4),
 * texture coordinates (2). Texture coordinates are in tiles of the material. v is 0 at the top row
 * of the maps and points downwards. */
#define MAPS_VERTEX 12

struct maps_mesh {
    GArray *vertices; /* float: number of vertices × MAPS_VERTEX */
    GArray *indices; /* guint32: number of triangles × 3, counter-clockwise as seen from outside */
};

/* Makes a plane of one tile, which faces upwards. */
struct maps_mesh maps_shapes_plane(const struct maps *maps);
/* Makes a sphere around the y axis with 6 × 3 tiles. */
struct maps_mesh maps_shapes_sphere(const struct maps *maps);
/* Returns x of the middle of the sphere. shapes is a sum of enum maps_shapes. The middle of the
 * plane is the origin. The sphere lies beside the plane if `shapes` contains both. */
double maps_shapes_aside(const struct maps *maps, int shapes);
void maps_shapes_clear(struct maps_mesh *mesh);
