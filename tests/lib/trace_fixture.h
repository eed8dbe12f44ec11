/* Small glTF scenes made from meshes, written to a temporary file. */
#pragma once

#include "shapes/scene.h"

#include <glib.h>

struct trace_object {
    const struct mesh *mesh; /* z is up, as in shapes/ */
    int material;            /* index into materials, or −1 */
    float scale, move[3];
    gboolean bare; /* leave out the texture coordinates */
};

/* Returns the text of a glTF 2.0 file with these objects; g_free(). materials has JSON objects
 * separated by commas. more has further members of the root, beginning with a comma, or is "".
 * nodes has the JSON objects of n_nodes further nodes, beginning with a comma, or is "". The scene
 * contains all nodes. */
char *trace_fixture_text(const struct trace_object *objects, int n, const char *materials,
                         const char *more, const char *nodes, int n_nodes);

/* Writes the text into a new folder. Returns the path; g_free(). Call remove_tree() for its dirname
 * afterwards. */
char *trace_fixture_write(const char *text);
