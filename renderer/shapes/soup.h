/* Polygon soup: the polygons of an OBJ or glTF file before they become an indexed mesh. */
#pragma once

#include "scene.h"

#define SOUP_MAX_CORNERS (3 * SCENE_MAX_VERTICES)

struct soup_corner {
    gint32 v, vt, vn; /* vn −1: made from the faces */
};

struct soup {
    GArray *positions, *normals; /* float[3] */
    GArray *uvs;                 /* float[2], v upwards */
    GArray *tangents;            /* float[4], one a position, [3] 0: none; or empty */
    GArray *corners, *polygons;  /* struct soup_corner; the number of corners of each (int) */
    float *smooth;               /* made: a normal for each position */
};

void soup_init(struct soup *soup);
void soup_clear(struct soup *soup);

/* Rotates a vector from a y-up to the z-up convention. */
void soup_y_to_z_up(float values[3]);

/* fit: scales it to radius 1 around the origin. NULL with an error that begins with where. */
struct mesh *soup_mesh(struct soup *soup, const char *name, const char *where, gboolean fit,
                       GError **error);
