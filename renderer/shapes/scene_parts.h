/*
 * A glTF scene of several materials as one mesh: materials are bound by their names in the file.
 * The first binding has material 1, the second 2, and so on; parts that no binding names have
 * material 0.
 *
 * Lengths stay those of the file; z is up, and the middle of the box around the objects becomes the
 * origin. A mesh in the lower half that is flat, faces up and reaches as far as everything else on
 * all sides is the mesh's floor, unless there is nothing else.
 */
#pragma once

#include "scene.h"

struct scene_binding {
    char *name, *path;
    double tiles; /* for one unit of the texture coordinates */
};

/* NAME=PATH or NAME=PATH,TILES; if the text after the last comma is no number, it belongs to the
 * path. Without TILES: 1. */
gboolean scene_binding_parse(const char *text, struct scene_binding *ret, GError **error);
void scene_binding_clear(struct scene_binding *binding);

/* Fails if a name is not in the scene, or a mesh of it has no texture coordinates. */
struct mesh *scene_read_parts(const char *path, const struct scene_binding *bindings, guint n,
                              GError **error);
