/*
 * Shadow maps (Wang et al. 2005 §4.2). A lamp that is infinitely far away has a parallel map; one
 * outside of the mesh's sphere, or with a narrow cone, a perspective map; any other near lamp six,
 * the faces of a cube around it. Depth is that of the base of the structure: the shadows that the
 * structure casts on itself are already part of the BTF.
 */
#pragma once

#include "visibility.h"

#define SHADOW_MAPS_MOST  64                     /* lamps, VIEWER_MAX_LAMPS */
#define SHADOW_MAPS_LAYER (6 * SHADOW_MAPS_MOST) /* layers, at most */

typedef struct ShadowMaps ShadowMaps; /* belongs to the thread of the GL context */

/* layered: a texture array; else a plain texture, of one lamp. */
ShadowMaps *shadow_maps_new(gboolean layered, GError **error);
void shadow_maps_free(ShadowMaps *maps); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ShadowMaps, shadow_maps_free)

struct shadow_scene {
    struct visibility_scene casting; /* sight, reach, projection, size: as each lamp needs them */
    double radius;                   /* radius of its sphere around the origin */
    guint serial;                    /* another one for each mesh */
    int size;                        /* of a map, each way */
};

struct shadow_lamp {
    float place[4]; /* w 1: where it is, not the origin; w 0: unit, towards a lamp far away */
    float axis[3];  /* with a cone: unit, the way its light goes */
    float cone_rad; /* half the angle that holds its light; 0: it shines all around */
};

/* Layers of the maps of n lamps: the first n are the first of each lamp, then follow five for each
 * lamp that has six. */
int shadow_maps_layers(const struct shadow_lamp *lamps, int n, double radius);

/* Draws only those maps whose lamp, mesh, tiles, MDF or options have changed. Without layers n is 1
 * and the lamp far away. */
gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const struct shadow_lamp *lamps, int n,
                          GError **error);
/* What further_right[] in further.glsl says of each lamp; after shadow_maps_find(). */
void shadow_maps_axes(const ShadowMaps *maps, const struct shadow_lamp *lamps, int n, double radius,
                      float (*ret)[3]);
void shadow_maps_forget(ShadowMaps *maps); /* all are drawn again at the next call */

guint shadow_maps_texture(const ShadowMaps *maps);

/* The direction of a map's +x as a unit vector; its +y is towards × right. */
void shadow_maps_right(const float towards[3], float ret[3]);

/* Depth range of a map, for shaders, in world units: the distance towards the lamp, from the plane
 * through the origin, at depth 0; the length from depth 0 to depth 1; the depth bias. */
void shadow_maps_range(const ShadowMaps *maps, double radius, float ret[3]);
