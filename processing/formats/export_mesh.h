/* Exports the structure measured by an MDF as a closed mesh with overhangs (mdf_mesh.h), for
 * modelling programs and printers. Any thread. */
#pragma once

#include "export.h"

enum export_mesh_form {
    EXPORT_MESH_PLY, /* binary */
    EXPORT_MESH_OBJ,
    /* glTF 2.0, in metres with y upwards. PLY and OBJ are in mm of the sample frame, with z from
     * the top of the turntable. */
    EXPORT_MESH_GLB,
};

struct export_mesh_result {
    int n_views; /* number of measured views of the MDF */
    guint n_vertices, n_triangles;
};

/* Writes the mesh of one tile of products/mdf.exr of a session. Vertices have normals and texture
 * coordinates. u is 0 … 1 along a row of the session's texels. v is 0 … 1 towards +y in PLY and
 * OBJ, and towards −y in GLB. Fails if the session has no MDF. */
gboolean export_mesh(const char *session, const char *file, enum export_mesh_form form,
                     struct export_mesh_result *ret, GError **error);
