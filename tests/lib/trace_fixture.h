/* Small glTF scenes, written to a temporary file from meshes. */
#pragma once

#include "shapes/scene.h"

#include <glib.h>

struct trace_object {
    const struct mesh *mesh; /* z up, as shapes are */
    int material;            /* index into materials, or −1 */
    float scale, move[3];
    gboolean bare; /* without texture coordinates */
};

/* A glTF 2.0 text of these objects; materials: JSON objects with commas between them; more: further
 * members of the root, with a comma before, or ""; nodes: further nodes, with a comma before. The
 * scene names all nodes. g_free() */
char *trace_fixture_text(const struct trace_object *objects, int n, const char *materials,
                         const char *more, const char *nodes, int n_nodes);

/* Writes it into a new folder; remove_tree() its dirname. g_free() */
char *trace_fixture_write(const char *text);
