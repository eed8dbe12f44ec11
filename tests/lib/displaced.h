/*
 * The reference for pictures of a material on a torus or a cylinder. It is the same scene, with the
 * whole surface of the sample laid around the shape, tile by tile, and on the floor below it.
 * Embree traces it on the CPU (Wang et al. 2005 fig. 10). It shares no code with renderer/. Camera,
 * shapes and scales are written independently.
 *
 * A point of the sample's surface at (x, y) and height z is placed at the distance (z − reference)
 * · s from the shape, along its normal at u = (x / width + ½ + tile) / tiles; v is computed in the
 * same way. s is the length in the scene of 1 mm, the square root of the ratio of areas on the
 * shape and on the sample at this point. The tiles of the floor are square and as wide as the mean
 * tile of the shape. A cylinder stands upright and has flat ends, on which u = x / (2π radius) and
 * v = ±y / height.
 */
#pragma once

#include "world/truth.h"

struct displaced_shape {
    double radius, tube_radius; /* of a torus around z */
    double height;              /* above 0 for a cylinder with this radius and height */
    int tiles_u, tiles_v;
    double floor; /* half the width of the floor; 0 if there is no floor */
    double tile_mm, reference_mm;
};

struct displaced_camera { /* see scene/viewer.h */
    /* distance is from the origin, in the units of the scene and not in radii */
    double azimuth_deg, elevation_deg, distance, fov_deg;
    double right, up; /* the point that the camera looks at */
    double floor;     /* distance of the floor below the origin */
    int width, height;
};

enum displaced_part { DISPLACED_NONE, DISPLACED_SHAPE, DISPLACED_FLOOR };

struct displaced_pixel {
    enum displaced_part part;
    float distance; /* from the eye */
    /* the point lies in the shadow of the shape as a whole, see displaced_trace(); shadows of the
     * structure on itself do not count */
    gboolean shadowed;
    gboolean dark; /* the light does not reach the point, for any reason */
    float cosine;  /* of the angle between light and surface; 0 if the light comes from behind */
    float albedo[3];
};

typedef struct Displaced Displaced;

/* Makes the scene. surface is only read during the call. */
Displaced *displaced_new(const struct truth_surface *surface, const struct displaced_shape *shape);
void displaced_free(Displaced *displaced); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Displaced, displaced_free)

/* Traces one ray through the middle of each pixel, top row first, and one towards the light. light
 * is a unit vector towards it. shadowed is only computed for pixels that show the floor. */
void displaced_trace(Displaced *displaced, const struct displaced_camera *camera,
                     const double light[3], struct displaced_pixel *ret);
