/*
 * The visible part of a mesh at each pixel when its material has structure: a ray that enters the
 * mesh near its contour and leaves it again without meeting the structure sees what lies behind
 * (Wang et al. 2005 §4.1).
 *
 * The mesh should be closed. A ray that enters and does not leave counts as meeting the structure;
 * a ray that only leaves sees nothing. A scene of several meshes, which do not intersect, and
 * materials is searched as one.
 */
#pragma once

#include "gl/places.h"
#include "mdf_texture.h"

enum visibility_way {
    VISIBILITY_AUTO,  /* lists where there is OpenGL 4.3, else peeling; the same picture */
    VISIBILITY_PEEL,  /* Wang et al. 2005 fig. 7: the mesh is drawn twice per layer */
    VISIBILITY_LISTS, /* once, all its faces kept in a list per pixel; needs OpenGL 4.3 */
};

#define VISIBILITY_MAX_LAYERS 32
#define VISIBILITY_UNIT       11 /* of the texture found, in shaders that read it; and the next */

struct visibility_options {
    enum visibility_way way;
    int layers;        /* most pairs of front and back faces behind each other that are tested */
    gboolean straight; /* Wang et al. 2005 as printed: the mesh is flat under each ray */
    gboolean volume;   /* distances in volumes, as there; the parts say which have one */
};

#define VISIBILITY_MAX_PARTS 64

/* Indices of one material. */
struct visibility_part {
    const MdfTexture *mdf;
    struct places_source places; /* of the MDF's depths, as of values */
    float tiles[2];
    guint first_index, n_indices;
    gboolean volume; /* after mdf_texture_make_volume() */
    int material;    /* see relief_set_mdf() */
};

struct visibility_scene {
    guint array;
    struct visibility_part parts[VISIBILITY_MAX_PARTS];
    int n_parts;
    float projection[16];
    float sight[4]; /* [3] = 1: the eye; 0: unit, towards an eye infinitely far away */
    float reach;    /* of such an eye: a length larger than any of the scene */
    int width, height;
    struct visibility_options options;
};

typedef struct Visibility Visibility; /* belongs to the thread of the GL context */

Visibility *visibility_new(GError **error);
void visibility_free(Visibility *visibility); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Visibility, visibility_free)

/* Finds, and returns in ret_texture, RGBA32F of width × height: distance from the eye to the mesh
 * (far eyes: from a plane reach away), from there along the ray to the structure, from there to the
 * structure's base or the far side of the mesh, 1; all 0 where nothing is seen. The texture
 * belongs to the object and lasts until the next call. */
gboolean visibility_find(Visibility *visibility, const struct visibility_scene *scene,
                         guint *ret_texture, GError **error);

/* Sets what relief.glsl needs, MDF and tiles aside, in a program in use. */
void visibility_set_sight(guint program, const struct visibility_scene *scene);
