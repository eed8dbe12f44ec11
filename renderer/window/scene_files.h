/* The files of a scene of several materials (--material): its mesh, materials and MDFs. */
#pragma once

#include "scene/reference.h"
#include "viewer_options.h"

/* Makes the mesh of a shape as scene_make() does. With --material, uses scene_read_parts() instead.
 */
struct mesh *scene_files_mesh(const struct viewer_options *options, const char *shape,
                              const struct scene_options *how, GError **error);

/* Adds the materials of --material to a viewer. A session is drawn by `method` if --method names
 * `method` and `method` can draw sessions. Otherwise a session is drawn by the method that
 * method_of_session() returns. If relief is TRUE, the MDFs of the materials are also added if they
 * exist. */
gboolean scene_files_open(const struct viewer_options *options, const struct method *method,
                          gboolean relief, Viewer *viewer, GError **error);

/* Opens the uncompressed BTF of a session, or a compressed file. */
Reference *scene_files_reference(const char *path, GError **error);
