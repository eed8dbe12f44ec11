/*
 * A glTF scene of several materials as one mesh. Materials are bound by their names in the file.
 * The first binding has material 1, the second 2, and so on. A part with a material that no binding
 * names has material 0.
 *
 * Lengths are as in the file. z is up, and the middle of the box around the objects becomes the
 * origin. A mesh belongs to the floor if it is flat, faces up, lies in the lower half of the box
 * around all meshes, and reaches to all four sides of that box. If all meshes meet these
 * conditions, there is no floor.
 */
#pragma once

#include "scene.h"

struct scene_binding {
    char *name, *path;
    double tiles; /* number of tiles in one unit of the texture coordinates */
};

/* Parses NAME=PATH or NAME=PATH,TILES. If the text after the last comma is not a number, it belongs
 * to the path. The default of TILES is 1. */
gboolean scene_binding_parse(const char *text, struct scene_binding *ret, GError **error);
void scene_binding_clear(struct scene_binding *binding);

/* Reads a scene. Fails if no mesh has the material of a binding, or if a mesh with such a material
 * has no texture coordinates. */
struct mesh *scene_read_parts(const char *path, const struct scene_binding *bindings, guint n,
                              GError **error);
