/*
 * The materials of the surfaces of a scene, captured or plain. The functions compute the light that
 * a surface reflects from one direction, and draw directions to follow. Directions are in the frame
 * of the surface: x is along u of the texture, y along v upwards, and z along the normal. Any
 * thread may call these functions.
 */
#pragma once

#include "trace_plain.h"
#include "trace_random.h"
#include "trace_texture.h"

#include "material/material.h"

struct trace_surface {
    char *name; /* name in glTF; owned */
    struct trace_plain plain;
    /* texture that multiplies the base colour of `plain`; owned; NULL if there is none */
    TraceTexture *texture;
    /* why a texture of the file is not used; owned; NULL if there is no such reason */
    char *warning;
    double emission[3];         /* radiance of its front side */
    mesorig_material *material; /* owned; NULL if the surface is plain */
    char *path;                 /* path of material; owned */
    /* Number of tiles of the captured material in one unit of the texture coordinates. */
    double tiles;
    gboolean has_relief; /* if FALSE, rays end on the mesh */
};

/* The texture coordinates of the mesh at a hit, with v upwards. */
struct trace_texel {
    double u, v;
};

/* The point that a ray hits, and the texture coordinates there. */
struct trace_hit {
    const struct trace_surface *surface;
    struct vec3 position;
    struct vec3 facet;   /* normal of the triangle, on the side of the ray's origin */
    struct vec3 x, y, z; /* frame of the surface; z is on the same side as facet */
    struct trace_texel texel;
    double distance;
    /* index of an area of the scene if the ray hits its lit side; otherwise −1 */
    gint64 area;
    guint part;                  /* index of the part in the glTF scene */
    gboolean is_front;           /* whether the ray meets the front side of the triangle */
    struct mesorig_surface mesh; /* only on a surface with relief */
};

/* How directions are drawn: in proportion to the reflectance of the material, or evenly over the
 * hemisphere, for comparison. */
enum trace_drawing { TRACE_DRAW_BY_IMPORTANCE, TRACE_DRAW_EVENLY };

/* Sets ret_rgb to f cos θ_l, where f is the reflectance and θ_l is the angle from the normal to
 * `light`. This is the radiance that is reflected towards `view`, per unit of radiance and of solid
 * angle that arrives from `light`. */
void trace_surface_evaluate(const struct trace_surface *surface, struct trace_texel at,
                            struct vec3 view, struct vec3 light, double ret_rgb[3]);
/* Draws a light direction *ret_light, and sets ret_rgb to f cos θ_l for this direction. Returns the
 * density per solid angle of this direction.
 *
 * Returns 0 and sets ret_rgb to black if `view` or the drawn direction is not above the surface.
 * The path then ends. *ret_light may not have been set. */
double trace_surface_draw(const struct trace_surface *surface, struct trace_texel at,
                          struct vec3 view, enum trace_drawing drawing, struct trace_random *random,
                          struct vec3 *ret_light, double ret_rgb[3]);
/* Returns the density per solid angle with which trace_surface_draw() draws `light`. */
double trace_surface_density(const struct trace_surface *surface, struct trace_texel at,
                             struct vec3 view, struct vec3 light, enum trace_drawing drawing);
