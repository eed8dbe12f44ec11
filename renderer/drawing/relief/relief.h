/*
 * Silhouettes and cast shadows of a material's structure on a mesh (Wang et al. 2005 §4). Before
 * the mesh is drawn, relief_prepare() finds the visible surface of each pixel and draws the shadow
 * maps. The programs that draw the mesh read both, in visible.glsl, shadow.glsl and further.glsl.
 */
#pragma once

#include "shadow_maps.h"
#include "visibility.h"

#define RELIEF_MAX_LAMPS SHADOW_MAPS_MAX

typedef struct Relief Relief; /* belongs to the thread of the GL context */

Relief *relief_new(GError **error);
void relief_free(Relief *relief); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Relief, relief_free)

#define RELIEF_MAX_MATERIALS 16

/* Sets the MDF of a material. The number of the material must be below RELIEF_MAX_MATERIALS. NULL
 * makes the material smooth. Copies everything that it needs. On error, the previous MDF stays. */
gboolean relief_set_mdf(Relief *relief, int material, const struct mdf_source *mdf, GError **error);

/* Makes the next relief_prepare() draw all shadow maps again. Shadow maps also depend on things
 * that struct relief_scene does not contain. Call this function when one of these has changed. */
void relief_forget(Relief *relief);

gint64 relief_mdf_bytes(const Relief *relief); /* GPU memory of all MDFs */

struct relief_scene {
    /* The scene as the eye sees it. `mdf` of its parts is ignored, because the relief has the
     * MDFs. */
    struct visibility_scene seen;
    /* Number of indices at the beginning that cast shadows. All indices receive shadows. If there
     * are several parts, this number must not end within a part. */
    guint n_casting;
    double radius;  /* radius of the part that casts shadows */
    float light[3]; /* unit vector towards the first lamp */
    guint serial;   /* a different number for each mesh */
    /* `silhouettes`: silhouettes are drawn, which needs a part with an MDF. `shadows`: the shadows
     * of all lamps are drawn. */
    gboolean silhouettes, shadows;
    gboolean along_surface; /* textures for along.glsl are made and bound */
    gboolean lit;           /* the first lamp is on; if FALSE, it casts no shadow */
    double light_size_deg;  /* angular diameter of the first lamp, seen from the mesh; 0: sharp */
    int n_further;          /* number of further lamps */
    struct shadow_lamp further[RELIEF_MAX_LAMPS];
    /* Width and height of the first lamp's shadow map. The maps of further lamps have the same size
     * if there are at most 4 maps, half the size if there are at most 16, and otherwise a quarter
     * of the size. Some near lamps have six maps (shadow_maps.h). */
    int shadow_size;
};

/* Prepares a scene. May leave another framebuffer bound. Shadow maps are kept while lamp, mesh,
 * tiles, MDF and options stay the same. */
gboolean relief_prepare(Relief *relief, const struct relief_scene *scene, GError **error);

#define RELIEF_FURTHER_UNIT 14 /* unit of the shadow maps of further lamps */
#define RELIEF_DEPTHS_UNIT  16 /* unit of the depths of the first lamp's shadow map */

/* Sets the textures and uniforms of the relief in a program in use, for parts with this material.
 * The textures use the units VISIBILITY_UNIT, VISIBILITY_UNIT + 1, RELIEF_FURTHER_UNIT and
 * RELIEF_DEPTHS_UNIT. If rays are marched through the shell of the material's MDF, the function
 * also calls mdf_texture_bind_along(). That function uses further units if mdf_texture_make_along()
 * has been called. */
void relief_bind(const Relief *relief, int material, guint program);
