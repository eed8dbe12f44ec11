/*
 * How well outlines and shadow boundaries that the viewer draws agree with those of displaced
 * geometry (displaced.h): the part of the two areas' union that they share.
 */
#pragma once

#include "displaced.h"
#include "exr/exr.h"
#include "scene/viewer.h"

#include <math.h>

#define TORUS_RADIUS      1.0
#define TORUS_TUBE        0.4
#define TORUS_FLOOR       4.0 /* half its width in radii, as scene_make() has it */
#define TORUS_MESH_RADIUS (TORUS_RADIUS + TORUS_TUBE)

struct overlap {
    gint64 both, either;
};

struct scores {
    struct overlap outline; /* of the torus */
    struct overlap shadow;  /* on the floor, where both see the floor */
};

double overlap_share(const struct overlap *o);
void overlap_add(struct overlap *o, gboolean a, gboolean b);
struct displaced_camera silhouettes_camera(const struct viewer_settings *s, int width, int height);
struct displaced_pixel *silhouettes_trace(Displaced *displaced, const struct viewer_settings *s,
                                          int width, int height);

/* Distance along the ray through a pixel's middle to the plane that the floor lies in. */
double silhouettes_floor_distance(const struct displaced_camera *c, int i, int j);
void silhouettes_floor_point(const struct displaced_camera *c, int i, int j, double ret[3]);

/* What viewer_render_geometry(…, VIEWER_GEOMETRY_LIT, …) returned against what was traced. */
struct scores silhouettes_score(const float *seen, const struct displaced_pixel *truth,
                                const struct viewer_settings *s, int width, int height,
                                gboolean floor);
