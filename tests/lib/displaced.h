/*
 * What pictures of a material on a torus or a cylinder are compared with: the same scene with the
 * sample's whole surface laid around the shape, tile by tile, and on the floor below it, traced by
 * Embree on the processor (Wang et al. 2005 fig. 10). Shares nothing with renderer/: camera, shapes
 * and scales are written anew.
 *
 * A surface point at height z over the sample's (x, y) lies (z − reference) · s along the shape's
 * normal from the shape at u = (x / width + ½ + tile) / tiles, v likewise. s, lengths per mm, is
 * the square root of how much larger areas are on the shape at that point. The floor's tiles are
 * square, as wide as the shape's mean tile. A cylinder stands upright and has flat ends, on which
 * u = x / (2π radius) and v = ±y / height.
 */
#pragma once

#include "world/truth.h"

struct displaced_shape {
    double radius, tube_radius; /* of a torus around z */
    double height;              /* > 0: a cylinder of radius */
    int tiles_u, tiles_v;
    double floor; /* half width; 0: there is no floor */
    double tile_mm, reference_mm;
};

struct displaced_camera {                                 /* as view.h has it */
    double azimuth_deg, elevation_deg, distance, fov_deg; /* distance from the origin, no radii */
    double right, up;                                     /* what it looks at */
    double floor; /* how far the floor lies below the origin */
    int width, height;
};

enum displaced_part { DISPLACED_NONE, DISPLACED_SHAPE, DISPLACED_FLOOR };

struct displaced_pixel {
    enum displaced_part part;
    float distance;    /* from the eye */
    gboolean shadowed; /* by the shape as a whole: what shades itself is not counted, see below */
    gboolean dark;     /* by anything */
    float cosine;      /* of the light's angle to the surface, 0 from behind */
    float albedo[3];
};

typedef struct Displaced Displaced;

/* The surface is read during the call only. */
Displaced *displaced_new(const struct truth_surface *surface, const struct displaced_shape *shape);
void displaced_free(Displaced *displaced); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Displaced, displaced_free)

/* One ray through the middle of each pixel, top row first, and one to the light (unit, towards it).
 * shadowed is looked for from the floor only. */
void displaced_trace(Displaced *displaced, const struct displaced_camera *camera,
                     const double light[3], struct displaced_pixel *ret);
