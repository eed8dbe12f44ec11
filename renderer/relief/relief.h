/*
 * Silhouettes and cast shadows of a material's structure on a mesh (Wang et al. 2005 §4). Before
 * the mesh is drawn, relief_prepare() finds the visible surface of each pixel and draws the shadow
 * maps; the programs that draw the mesh read both in visible.glsl, shadow.glsl and further.glsl.
 */
#pragma once

#include "shadow_maps.h"
#include "visibility.h"

#define RELIEF_MAX_LAMPS SHADOW_MAPS_MOST

typedef struct Relief Relief; /* belongs to the thread of the GL context */

Relief *relief_new(GError **error);
void relief_free(Relief *relief); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Relief, relief_free)

#define RELIEF_MAX_MATERIALS 16

/* Sets the MDF of a material; its number is below RELIEF_MAX_MATERIALS. NULL: it is smooth. Copies
 * what it needs. On error the former MDF stays. */
gboolean relief_set_mdf(Relief *relief, int material, const struct mdf_source *mdf, GError **error);

/* Shadow maps are drawn again: what they depend on beside the scene has changed. */
void relief_forget(Relief *relief);

gint64 relief_mdf_bytes(const Relief *relief); /* GPU memory of all MDFs */

struct relief_scene {
    struct visibility_scene seen; /* by the eye; without its MDFs, which are those of the relief */
    guint n_casting; /* the first indices, which cast shadows; all indices receive them. With
                        several parts each casts wholly or not at all. */
    double radius;   /* of what casts */
    float light[3];
    guint serial; /* another one for each mesh */
    /* Silhouettes and the shadows of every lamp; silhouettes need the MDF of a part. */
    gboolean silhouettes, shadows;
    gboolean lit; /* by the first lamp; FALSE: it is off and casts no shadow */
    int n_further;
    struct shadow_lamp further[RELIEF_MAX_LAMPS];
    /* Width and height of the first lamp's shadow map. The maps of further lamps have the same size
     * up to 4 maps, half of it up to 16 and a quarter beyond. A lamp amid the mesh has six maps. */
    int shadow_size;
};

/* Leaves framebuffers of its own bound. Shadow maps are kept while lamp, mesh, tiles, MDF and
 * options stay the same. */
gboolean relief_prepare(Relief *relief, const struct relief_scene *scene, GError **error);

#define RELIEF_FURTHER_UNIT 14 /* of the shadow maps of further lamps */

/* Sets the textures from VISIBILITY_UNIT on and the uniforms of a program in use. */
void relief_bind(const Relief *relief, guint program);
