/*
 * The visible part of a mesh at each pixel, for a material with structure. A ray may enter the mesh
 * near its contour and leave it again without meeting the structure. The ray then sees the surface
 * behind (Wang et al. 2005 §4.1).
 *
 * The mesh should be closed. A ray that enters the mesh and does not leave it counts as meeting the
 * structure. A ray that leaves the mesh without entering it sees nothing. A scene may have several
 * meshes, which must not intersect, and several materials. All its parts are searched together.
 */
#pragma once

#include "drawing/gl/places.h"
#include "mdf_texture.h"

enum visibility_way {
    /* Uses lists if OpenGL 4.3 is available, and peeling otherwise. Both give the same pictures. */
    VISIBILITY_AUTO,
    VISIBILITY_PEEL, /* Wang et al. 2005 fig. 7: the mesh is drawn twice per layer */
    /* Front faces behind which the structure is certain are drawn first. All faces that they do not
     * hide are then kept in a list for each pixel. Needs OpenGL 4.3. */
    VISIBILITY_LISTS,
};

#define VISIBILITY_MAX_LAYERS 32
#define VISIBILITY_UNIT                                                                            \
    11 /* unit of the resulting texture in shaders that read it; the next unit is also used */

struct visibility_options {
    enum visibility_way way;
    /* Largest number of pairs of a front face and a back face that are tested along a ray. */
    int layers;
    gboolean straight; /* Wang et al. 2005 as printed: the mesh is taken as flat under each ray */
    /* Distances are read from volumes, as in Wang et al. 2005, for each part that has a volume. */
    gboolean volume;
    /* Distances are mixed from those of the nearest views. If none of straight, volume and views is
     * set, rays are marched through the shell of the MDF. */
    gboolean views;
};

#define VISIBILITY_MAX_PARTS 64

/* A part of the mesh, with one material. */
struct visibility_part {
    const MdfTexture *mdf;
    /* The places at which depths of the MDF are read. Reflectance is read at the same places. */
    struct places_source places;
    float tiles[2]; /* repetitions of the material along u and v */
    guint first_index, n_indices;
    gboolean volume; /* mdf_texture_make_volume() has made the volume of mdf */
    gboolean shell;  /* mdf_texture_make_shell() has made the shell of mdf */
    int material;    /* see relief_set_mdf() */
};

struct visibility_scene {
    guint array; /* vertex array of the mesh */
    struct visibility_part parts[VISIBILITY_MAX_PARTS];
    int n_parts;
    float projection[16]; /* from world to clip coordinates, column-major */
    /* [3] = 1: position of the eye; [3] = 0: unit vector towards an eye infinitely far away */
    float sight[4];
    float reach;       /* for an eye infinitely far away: a length larger than any in the scene */
    int width, height; /* of the resulting texture */
    /* TRUE if the caller needs only the distances to the mesh and to the base of the structure; see
     * visibility_find(). */
    gboolean base_only;
    struct visibility_options options;
};

typedef struct Visibility Visibility; /* belongs to the thread of the GL context */

Visibility *visibility_new(GError **error);
void visibility_free(Visibility *visibility); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Visibility, visibility_free)

/* Finds the visible surface. *ret_texture is a texture of width × height, RGBA32F:
 * - R is the distance from the eye to the mesh. For a distant eye, the distance is measured from
 *   the plane at the distance `reach`.
 * - G is the distance along the ray from the mesh to the structure. With base_only, G may be the
 *   distance to the base of the structure instead.
 * - B is the distance along the ray from the mesh to the base of the structure, or to the far side
 *   of the mesh if that is nearer.
 * - A is 1.
 *
 * All four are 0 where nothing is seen. The Visibility owns the texture, which is valid until the
 * next call. */
gboolean visibility_find(Visibility *visibility, const struct visibility_scene *scene,
                         guint *ret_texture, GError **error);

/* Sets the uniforms of relief.glsl in a program in use, except the uniforms of the MDF and of the
 * tiles. */
void visibility_set_sight(guint program, const struct visibility_scene *scene);
