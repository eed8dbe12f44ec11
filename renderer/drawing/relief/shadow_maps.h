/*
 * Shadow maps (Wang et al. 2005 §4.2). The number of maps depends on the lamp:
 * - A lamp that is infinitely far away has one map, in parallel projection.
 * - A near lamp with a cone of at most 75° half-angle has one map, in perspective.
 * - A lamp without a cone that is at least 1.2 radii of the mesh from the origin also has one map,
 *   in perspective.
 * - Any other near lamp has six maps, the faces of a cube around the lamp.
 *
 * A map stores the depth of the base of the structure, because shadows of the structure on itself
 * are already part of the BTF.
 */
#pragma once

#include "visibility.h"

#define SHADOW_MAPS_MAX   64                    /* number of lamps, VIEWER_MAX_LAMPS */
#define SHADOW_MAPS_LAYER (6 * SHADOW_MAPS_MAX) /* largest number of layers */

typedef struct ShadowMaps ShadowMaps; /* belongs to the thread of the GL context */

/* Makes shadow maps. If layered is TRUE, they are a texture array. Otherwise there is one plain
 * texture, for one lamp. */
ShadowMaps *shadow_maps_new(gboolean layered, GError **error);
void shadow_maps_free(ShadowMaps *maps); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ShadowMaps, shadow_maps_free)

struct shadow_scene {
    /* The caller sets all members except `sight`, `reach`, `projection`, `width`, `height` and
     * `base_only`. */
    struct visibility_scene casting;
    double radius; /* radius of a sphere around the origin that contains the mesh */
    guint serial;  /* a different number for each mesh */
    int size;      /* width and height of a map */
};

struct shadow_lamp {
    /* [3] = 1: position, which must not be the origin; [3] = 0: unit vector towards a distant
     * lamp */
    float place[4];
    float axis[3]; /* for a lamp with a cone: unit vector along which the light goes */
    /* half the angle of the cone of light; 0 if the lamp shines in all directions */
    float cone_rad;
};

/* Returns the number of layers for n lamps. Layer k is the first map of lamp k, for k < n. The
 * layers from n on are the other five maps of each lamp that has six maps. */
int shadow_maps_layers(const struct shadow_lamp *lamps, int n, double radius);

/* Draws each map again if its lamp, mesh, tiles, MDF or options have changed since the last call.
 * Maps that are not layered allow only one lamp (n = 1), which must be far away. */
gboolean shadow_maps_find(ShadowMaps *maps, Visibility *visibility,
                          const struct shadow_scene *scene, const struct shadow_lamp *lamps, int n,
                          GError **error);
/* Computes the element of further_right[] (further.glsl) of each of the n lamps. Call this function
 * after shadow_maps_find(). */
void shadow_maps_axes(const ShadowMaps *maps, const struct shadow_lamp *lamps, int n, double radius,
                      float (*ret)[3]);
void shadow_maps_forget(ShadowMaps *maps); /* shadow_maps_find() then draws all maps again */

guint shadow_maps_texture(const ShadowMaps *maps);

/* Sets ret to the unit vector along +x of a map. towards is the unit vector opposite to the
 * direction in which the map looks; for a distant lamp, it points towards the lamp. The map's +y is
 * towards × ret. */
void shadow_maps_right(const float towards[3], float ret[3]);

/* Computes three lengths for shaders, in world units. ret[0] is the distance, towards the lamp,
 * from the plane through the origin to the plane of depth 0. ret[1] is the length from depth 0 to
 * depth 1. ret[2] is the depth bias. */
void shadow_maps_range(const ShadowMaps *maps, double radius, float ret[3]);
