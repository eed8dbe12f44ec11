/*
 * How well outlines and shadow boundaries that the viewer draws agree with those of displaced
 * geometry (displaced.h): the part of the two areas' union that they share.
 */
#pragma once

#include "displaced.h"
#include "exr/exr.h"
#include "scene/viewer.h"

#include <math.h>

#define SILHOUETTES_FLOOR 4.0 /* half its width in the mesh's radii, as scene_make() has it */

/* A shape as scene_make() makes it. */
struct silhouettes_shape {
    const char *name;
    double radius, tube_radius, height; /* as in displaced.h */
    double mesh_radius;                 /* of the sphere around the origin that holds it */
    double floor;                       /* how far the floor lies below the origin */
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
    struct overlap shadow;  /* on the floor, where both see the floor */
};

double overlap_share(const struct overlap *o);
void overlap_add(struct overlap *o, gboolean a, gboolean b);
struct displaced_camera silhouettes_camera(const struct silhouettes_shape *shape,
                                           const struct viewer_settings *s, int width, int height);
struct displaced_pixel *silhouettes_trace(const struct silhouettes_shape *shape,
                                          Displaced *displaced, const struct viewer_settings *s,
                                          int width, int height);

/* Distance along the ray through a pixel's middle to the plane that the floor lies in. */
double silhouettes_floor_distance(const struct displaced_camera *c, int i, int j);
void silhouettes_floor_point(const struct displaced_camera *c, int i, int j, double ret[3]);

/* What viewer_render_geometry(…, VIEWER_GEOMETRY_LIT, …) returned against what was traced. */
struct scores silhouettes_score(const struct silhouettes_shape *shape, const float *seen,
                                const struct displaced_pixel *truth,
                                const struct viewer_settings *s, int width, int height,
                                gboolean floor);
