/*
 * Shadow maps of lamps that are infinitely far away (Wang et al. 2005 §4.2), one layer per lamp.
 * Depth is that of the base of the structure: the shadows that the structure casts on itself are
 * already part of the BTF.
 */
#pragma once

#include "visibility.h"

#define SHADOW_MAPS_MOST 64 /* lamps, VIEWER_MAX_LAMPS */

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

/* towards: n unit vectors. Draws only those maps whose lamp, mesh, tiles, MDF or options have
 * changed. */
gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const float (*towards)[3], int n,
                          GError **error);
void shadow_maps_forget(ShadowMaps *maps); /* all are drawn again at the next call */

guint shadow_maps_texture(const ShadowMaps *maps);

/* The direction of a map's +x as a unit vector; its +y is towards × right. */
void shadow_maps_right(const float towards[3], float ret[3]);

/* Depth range of a map, for shaders, in world units: the distance towards the lamp, from the plane
 * through the origin, at depth 0; the length from depth 0 to depth 1; the depth bias. */
void shadow_maps_range(const ShadowMaps *maps, double radius, float ret[3]);
