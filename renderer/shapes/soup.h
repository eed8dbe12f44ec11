/* Polygon soup: the polygons of an OBJ or glTF file before they become an indexed mesh. */
#pragma once

#include "scene.h"

#define SOUP_MAX_CORNERS (3 * SCENE_MAX_VERTICES)

struct soup_corner {
    gint32 v, vt, vn; /* vn is −1 if the normal is computed from the faces */
};

struct soup {
    GArray *positions, *normals; /* float[3] */
    GArray *uvs;                 /* float[2], with v upwards */
    /* float[4] for each position. [3] is 0 if the position has no tangent. The array is empty if
     * the file has no tangents. */
    GArray *tangents;
    /* `corners`: a struct soup_corner for each corner of all polygons, one polygon after the other.
     * `polygons`: the number of corners of each polygon (int). */
    GArray *corners, *polygons;
    /* float[3] for each position: normal that was computed from the faces, not of unit length */
    float *smooth;
};

void soup_init(struct soup *soup);
void soup_clear(struct soup *soup);

/* Rotates a vector from a y-up to a z-up frame. */
void soup_y_to_z_up(float values[3]);

/* Makes a mesh. If fit is TRUE, the mesh is centred and scaled to radius 1 around the origin. On
 * failure, returns NULL with an error whose message begins with the text `where`. */
struct mesh *soup_mesh(struct soup *soup, const char *name, const char *where, gboolean fit,
                       GError **error);
