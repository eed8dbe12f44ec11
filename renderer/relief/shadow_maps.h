/*
 * Maps of how far the light of lamps far away gets (Wang et al. 2005 §4.2), a layer a lamp:
 * measured from the base of the structure, for what it shades itself is in the BTF already.
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
    double radius;                   /* of it, around the origin */
    guint serial;                    /* another one for each mesh */
    int size;                        /* of a map, each way */
};

/* towards: n unit vectors. Those maps are drawn anew whose lamp, mesh, tiles, MDF or options are
 * not what they were. */
gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const float (*towards)[3], int n,
                          GError **error);
void shadow_maps_forget(ShadowMaps *maps); /* all are drawn anew at the next call */

guint shadow_maps_texture(const ShadowMaps *maps);
int shadow_maps_size(const ShadowMaps *maps);

/* Where a map's right points to, as a unit vector; its up is towards × right. */
void shadow_maps_right(const float towards[3], float ret[3]);

/* Of a map, for shaders: the distance from a plane towards the lamp that depth 0 stands for, from
 * there to depth 1, and what a point may be farther for all that is not exact. */
void shadow_maps_range(const ShadowMaps *maps, double radius, float ret[3]);
