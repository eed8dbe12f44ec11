/*
 * Which part of a mesh is seen through each pixel once the structure of its material counts: rays
 * that enter the mesh near its contour and leave it again without meeting the structure see what is
 * behind (Wang et al. 2005 §4.1).
 *
 * The mesh should be closed. Where a ray enters and does not leave, it is taken to meet the
 * structure; where it only leaves, nothing is seen.
 */
#pragma once

#include "mdf_texture.h"

enum visibility_way {
    VISIBILITY_AUTO,  /* lists where there is OpenGL 4.3, else peeling; the same picture */
    VISIBILITY_PEEL,  /* Wang et al. 2005 fig. 7: the mesh is drawn twice a layer */
    VISIBILITY_LISTS, /* once, all its faces kept in a list a pixel; needs OpenGL 4.3 */
};

#define VISIBILITY_MAX_LAYERS 32
#define VISIBILITY_UNIT       11 /* of the texture found, in shaders that read it; and the next */

struct visibility_options {
    enum visibility_way way;
    int layers;        /* at most so many pairs of faces behind each other */
    gboolean straight; /* Wang et al. 2005 as printed: the mesh is flat under each ray */
};

struct visibility_scene {
    const MdfTexture *mdf;
    guint array, n_indices;
    float projection[16];
    float sight[4]; /* [3] = 1: the eye; 0: unit, towards an eye infinitely far away */
    float reach;    /* of such an eye: a length larger than any of the scene */
    float tiles[2];
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

/* Sets what relief.glsl needs, the MDF aside, in a program in use. */
void visibility_set_sight(guint program, const struct visibility_scene *scene);
