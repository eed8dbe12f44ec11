/*
 * Compares the outlines and shadow boundaries that the viewer draws with those of displaced
 * geometry (displaced.h). The measure is the area that both cover, relative to the area that at
 * least one covers.
 */
#pragma once

#include "displaced.h"
#include "exr/exr.h"
#include "scene/viewer.h"

#include <math.h>

/* half the width of the floor in radii of the mesh, as in scene_make() */
#define SILHOUETTES_FLOOR 4.0

/* A shape that scene_make() also makes. */
struct silhouettes_shape {
    const char *name;
    double radius, tube_radius, height; /* as in displaced.h */
    double mesh_radius; /* radius of the sphere around the origin that contains the mesh */
    double floor;       /* distance of the floor below the origin */
};
extern const struct silhouettes_shape silhouettes_torus, silhouettes_cylinder;

struct displaced_shape silhouettes_displaced(const struct silhouettes_shape *shape, int tiles_u,
                                             int tiles_v, gboolean floor, double tile_mm,
                                             double reference_mm);

struct overlap {
    gint64 both, either;
};

struct scores {
    struct overlap outline; /* of the shape */
    struct overlap shadow;  /* on the floor, where both pictures show the floor */
};

double overlap_share(const struct overlap *o);
void overlap_add(struct overlap *o, gboolean a, gboolean b);
struct displaced_camera silhouettes_camera(const struct silhouettes_shape *shape,
                                           const struct viewer_settings *s, int width, int height);
struct displaced_pixel *silhouettes_trace(const struct silhouettes_shape *shape,
                                          Displaced *displaced, const struct viewer_settings *s,
                                          int width, int height);

/* Returns the distance along the ray through the middle of a pixel to the plane of the floor. */
double silhouettes_floor_distance(const struct displaced_camera *c, int i, int j);
void silhouettes_floor_point(const struct displaced_camera *c, int i, int j, double ret[3]);

/* Compares the values of viewer_render_geometry(…, VIEWER_GEOMETRY_LIT, …) with the traced
 * pixels. */
struct scores silhouettes_score(const struct silhouettes_shape *shape, const float *seen,
                                const struct displaced_pixel *truth,
                                const struct viewer_settings *s, int width, int height,
                                gboolean floor);
