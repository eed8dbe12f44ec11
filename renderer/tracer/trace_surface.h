/*
 * What the surfaces of a scene are made of: a captured material or a plain one; how they reflect
 * light from one direction, and directions to follow. Directions are in the surface's frame: x
 * along the texture's u, y along its v upwards, z along the normal. Any thread.
 */
#pragma once

#include "trace_plain.h"
#include "trace_random.h"
#include "trace_texture.h"

#include "material/material.h"

struct trace_surface {
    char *name; /* of glTF; owned */
    struct trace_plain plain;
    TraceTexture *texture; /* multiplies plain's base; owned; NULL: none */
    char *warning;         /* why there is no texture although the file has one; owned, or NULL */
    double emission[3];    /* radiance of its front */
    mesorig_material *material; /* owned; NULL: plain */
    char *path;                 /* of material; owned */
    double tiles;               /* of material for one unit of the texture coordinates */
    struct trace_relief {
        double deepest_mm; /* 0: rays end on the mesh */
        double tile_mm[2];
    } relief;
};

/* Where a surface is hit. uv: the mesh's, v upwards. */
struct trace_texel {
    double u, v;
};

/* How directions are drawn: by the material's own distribution, or evenly over the hemisphere, to
 * compare with. */
enum trace_drawing { TRACE_DRAW_BY_IMPORTANCE, TRACE_DRAW_EVENLY };

/* f cos θ_l: what is reflected towards view of a radiance from light, per solid angle. */
void trace_surface_evaluate(const struct trace_surface *surface, struct trace_texel at,
                            struct vec3 view, struct vec3 light, double ret_rgb[3]);
/* Returns the density per solid angle of *ret_light, 0: there is none, light is absorbed. ret_rgb:
 * f cos θ_l. */
double trace_surface_draw(const struct trace_surface *surface, struct trace_texel at,
                          struct vec3 view, enum trace_drawing drawing, struct trace_random *random,
                          struct vec3 *ret_light, double ret_rgb[3]);
double trace_surface_density(const struct trace_surface *surface, struct trace_texel at,
                             struct vec3 view, struct vec3 light, enum trace_drawing drawing);
